"""A results folder as the stages leave it: four devices, one of each kind that a report meets.

`board` is complete; `still` has two static sessions with temperature, and a hostile label;
`partly` has a rejected session; of `nothing` every session was rejected.
"""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from imuloop.core.files import write_json
from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.core.samples import CHANNELS, schema
from imuloop.core.segments import segment_table
from imuloop.core.tables import write_table
from imuloop.core.units import RawUnit
from imuloop.diagnose.tables import no_tables
from imuloop.effects.other_sensor import GSensitivity
from imuloop.export.export import write_exports
from imuloop.model.calibration import Calibration
from imuloop.model.effect import FittedEffect
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.noise.spectrum import no_spectrum
from imuloop.report.findings import UNTESTED
from imuloop.validate.attitude import no_attitude
from report.plausible_diagnosis import pose_tables, static_diagnosis
from report.plausible_noise import plausible_noise, plausible_spectra, statistics

MADE = yaml.safe_load(Path(__file__).with_name("plausible.yaml").read_text("utf-8"))
HOSTILE = '<script>alert(1)</script> $x_2$ & "_b"'
DEVICES = {
    "board": ("Board A", {"long": "static", "faces": "six_position", "turns": "multi_position"}),
    "still": (HOSTILE, {"night": "static", "day": "static"}),
    "partly": ("_Board B $\\frac{1}{2}$", {"rest": "static", "turns": "multi_position"}),
    "nothing": ("Board C", {"turns": "multi_position"}),
}
REJECTED = {("partly", "turns"), ("nothing", "turns")}
# verdicts on static records, where they are not `consistent`
VERDICTS = {
    ("board", "gyroscope"): "unexplained",
    ("still", "accelerometer"): "explained",
    ("still", "gyroscope"): "partly_explained",
}
RATE = 20.0
UNIT_A, UNIT_G = RawUnit("count", 0.0024, 32768.0), RawUnit("deg/s", np.pi / 180)
N, B = {"a": 8e-4, "g": 7e-5}, {"a": 3e-4, "g": 2e-5}
FEW = "9 poses found, 12 needed: hold at least 3 more attitudes"
BASE = tuple(f"{p}{i}" for p in "Kb" for i in range(3))
UPPER, FULL = ("T01", "T02", "T12"), ("T01", "T02", "T10", "T12", "T20", "T21")


def write_results(folder):
    """Write results/<device>/… of all devices into `folder`; return {device: (label, kinds)}."""
    for seed, (device, (_, sessions)) in enumerate(DEVICES.items()):
        rng = np.random.default_rng(seed)
        for session, kind in sessions.items():
            _session(folder / device, device, session, kind, rng)
        _device(folder / device, device, sessions, rng)
        files = {name: name for name in ("README.txt", "kalibr_imu.yaml")}
        write_exports(folder / device / "exports", files)
    return DEVICES


def _session(folder, device, session, kind, rng):
    path = folder / session
    path.mkdir(parents=True)
    rejected, warm = (device, session) in REJECTED, device == "still"
    t = np.arange(0, 0 if rejected else 900 if kind == "static" else 240, 1 / RATE)
    if kind == "static" and len(t):
        t = t[(t < 300) | (t > 320)]
    samples, edges = _signal(t, kind, rng)
    if warm:
        samples["temperature"] = 20 + t / 60
    metadata = {
        "source": {"log": {"path": f"data/{session}.csv"}},
        "sha256": {f"{session}.csv": f"{len(t):064x}"},
        "simulated": warm,
    }
    table = pa.Table.from_pandas(samples, preserve_index=False)
    metadata = schema(metadata).metadata
    pq.write_table(table.replace_schema_metadata(metadata), path / "samples.parquet")
    chosen = {"short_rests": 2}
    write_table(path / "segments.parquet", segment_table(samples, *edges), chosen)
    reasons = ["angular rate: 'gx' is constant over all 4,800 rows; log it again"]
    quality = {
        "status": "rejected" if rejected else "ok",
        "reasons": reasons if rejected else [],
        "rows": len(t),
        "duration_s": t[-1] if len(t) else 0.0,
        "warnings": ["1 gap, 20 s together <i>"] if kind == "static" else [],
        "simulated": warm,
        "source": {"log": {"path": f"{session}.csv"}},
        "jitter": {"std_s": None if rejected else 1.2e-4, "max_s": 1e-3},
    }
    write_json(path / "quality.json", MADE["quality"] | quality)
    allan = _allan(list(DEVICES).index(device))
    if rejected or kind != "static":
        allan = allan[:0]
    allan.to_parquet(path / "allan.parquet")
    if session == next(iter(DEVICES[device][1])):
        spectra = pd.DataFrame(no_spectrum())
        if device == "board":
            spectra = plausible_spectra(samples, RATE)
        spectra.assign(session=session).to_parquet(path.parent / "spectra.parquet")


def _signal(t, kind, rng):
    """Return samples, and the edges, kinds and poses of their stretches."""
    x = rng.normal(size=(len(t), 6)) * ([4e-3] * 3 + [4e-4] * 3)
    if kind == "static":
        x[:, 2] += 9.8
        x[(t > 600) & (t < 606), 0] += 0.4
        start, end = [0, 300, 320, 600, 606], [300, 320, 600, 606, 900]
        kinds = ["static", "gap", "static", "disturbed", "static"]
        edges = start, end, kinds, [0, -1, 0, -1, 0]
    else:
        count = 6 if kind == "six_position" else 24
        length = 240 / count
        up = np.concatenate([np.eye(3), -np.eye(3)])
        if kind == "multi_position":
            up = rng.normal(size=(count, 3))
            up /= np.linalg.norm(up, axis=1, keepdims=True)
        pose = np.minimum((t / length).astype(int), count - 1)
        moving = t - pose * length > length - 3
        x[:, :3] += 9.8 * up[pose] + moving[:, None] * rng.normal(size=(len(t), 3)) * 3
        x[:, 3:] += moving[:, None] * rng.normal(size=(len(t), 3))
        start = np.repeat(np.arange(count) * length, 2) + np.tile([0, length - 3], count)
        poses = np.where(np.arange(2 * count) % 2, -1, np.arange(2 * count) // 2)
        edges = start, [*start[1:], 240.0], ["static", "motion"] * count, poses
    samples = pd.DataFrame(np.column_stack([t, x]), columns=["t", *CHANNELS])
    return samples, edges if len(t) else ([], [], [], [])


def _allan(place):
    tau, tables = np.geomspace(0.1, 300, 30), []
    for i, axis in enumerate(CHANNELS):
        adev = np.sqrt(N[axis[0]] ** 2 / tau + 0.44 * B[axis[0]] ** 2) * (1 + 0.2 * i + 0.5 * place)
        width = 1 + 0.4 * tau / 300
        columns = {"axis": axis, "tau_s": tau, "ci_low": adev / width, "ci_high": adev * width}
        for stage, factor in (("raw", 1.1), ("corrected", 1.0)):
            tables.append(pd.DataFrame(columns | {"adev": adev * factor, "stage": stage}))
    return pd.concat(tables, ignore_index=True)


def _noise(device):
    seen, worse = device != "nothing", 1 + 0.5 * list(DEVICES).index(device)
    limit = Coefficient(upper95=3e-6) if seen else Coefficient()
    axes = {}
    for axis in CHANNELS:
        own = {k: size[axis[0]] * worse for k, size in (("N", N), ("B", B)) if seen}
        own = {k: Coefficient.of(value, value / 39.2) for k, value in own.items()}
        axes[axis] = AxisNoise(**dict.fromkeys("QNBKR", limit) | own)
    session = next(iter(DEVICES[device][1]))
    return {
        # what a noise stage may leave without an answer
        "rate_hz": None,
        "rates_hz": {},
        "spectrum": {},
        "format": 1,
        "device": device,
        "axes": {a: asdict(noise) for a, noise in axes.items()},
        "statistics": {session: statistics()} if seen else {},
        "sessions": [session],
        "notes": [] if seen else ["no rest is long enough"],
        **(plausible_noise(axes, RATE) if device == "board" else {}),
    }


def _fitted(unit, names, method="multi_position", seed=0):
    rng = np.random.default_rng(seed)
    T = np.eye(3)
    for name in names:
        if name[0] == "T":
            T[int(name[1]), int(name[2])] = rng.normal() * 5e-3
    K = unit.scale * (1 + rng.normal(size=3) * 4e-3)
    b = unit.offset + rng.normal(size=3) * 0.05 / unit.scale
    std = {"T": 1e-4, "K": 2e-4 * unit.scale, "b": 2e-3 / unit.scale}
    mix = np.eye(len(names)) + 0.3 * rng.normal(size=(len(names),) * 2) / len(names)
    root = np.diag([std[name[0]] for name in names]) @ mix
    return SensorCalibration(unit, T, K, b, names, root @ root.T, (), method, None, 1.1)


def _device(folder, device, sessions, rng):
    nominal = (SensorCalibration.nominal(unit, FEW) for unit in (UNIT_A, UNIT_G))
    six = multi = final = Calibration(device, 9.80665, *nominal)
    untested = UNTESTED | {"why": FEW}
    poses = {"accelerometer": untested, "gyroscope": untested}
    tables = no_tables()
    if device == "board":
        poses = {sensor: UNTESTED | block for sensor, block in MADE["poses"].items()}
        gain = poses["gyroscope"]["effects"][0]["parameters"]
        effect = FittedEffect(GSensitivity(), gain, dict.fromkeys(gain, 2e-6))
        faces = _fitted(UNIT_A, UPPER + BASE, "six_position", seed=3)
        six = Calibration(device, 9.80665, faces, _fitted(UNIT_G, BASE[3:], "static"))
        force, turn = _fitted(UNIT_A, UPPER + BASE, seed=1), _fitted(UNIT_G, FULL + BASE, seed=2)
        multi = Calibration(device, 9.80665, force, turn)
        final = replace(multi, gyroscope=replace(turn, effects=(effect,), verdict="unexplained"))
        tables = pose_tables(folder, rng)
    elif device in ("still", "partly"):
        multi = final = replace(six, gyroscope=_fitted(UNIT_G, BASE[3:], "static", seed=4))
    records = [name for name, kind in sessions.items() if kind == "static"]
    diagnosis = {}
    for sensor, block in poses.items():
        verdict = VERDICTS.get((device, sensor), "consistent")
        still = static_diagnosis(sensor, records, verdict, rng)
        diagnosis[sensor] = {"poses": block, "static_record": still}
    six.to_json(folder / "six_position.json")
    multi.to_json(folder / "multi_position.json")
    final.to_json(folder / "calibration.json")
    write_json(folder / "noise.json", _noise(device))
    tables["attitude"] = no_attitude(device, FEW)[1]
    write_json(folder / "attitude.json", no_attitude(device, FEW)[0])
    for name, columns in tables.items():
        write_table(folder / f"{name}.parquet", columns)
    write_json(folder / "diagnosis.json", {"format": 1, "device": device, "sensors": diagnosis})
