"""A prior from a file: the other devices of the type, or an earlier calibration of the device."""

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from calibrate.devices import (
    UNITS,
    calibrate_recording,
    in_counts,
    known_noise,
    plan_session,
    recording,
)
from family.members import sensor
from imuloop.core.errors import ImuloopError
from imuloop.core.files import plain
from imuloop.core.samples import SENSORS
from imuloop.effects.turn_on_bias import TURN_ON, TurnOnBias
from imuloop.family.family import Member, write_family
from imuloop.family.prior import read_prior
from imuloop.model.calibration import Calibration
from imuloop.model.effect import FittedEffect
from imuloop.model.prior import data_sheet
from imuloop.model.raw_units import in_nominal_si
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.model.state import BASE, parameters
from imuloop.simulate.truth import example_truth
from seeds import seeds

EXAMPLE = example_truth(rate=25.0)
NOISE = known_noise(EXAMPLE)
NAMES = [f"{s}.{name}" for s, name, _ in parameters()]
BIAS = np.array([name.partition(".")[2][0] == "b" for name in NAMES])
# mean of the devices of a type, drawn within a data sheet's tolerances, and their spread
SHEET = {"T": 0.02, "K": 0.03, "accelerometer.b": 0.5, "gyroscope.b": 0.2}
SIZE = np.array([SHEET.get(name[:-1]) or SHEET[name.partition(".")[2][0]] for name in NAMES])
LOT = SIZE * np.random.default_rng(1).normal(size=len(NAMES))
SPREAD, ERROR = 0.1 * SIZE, 0.005 * SIZE
NOMINAL = {s: SensorCalibration.nominal(unit, "no rest") for s, unit in UNITS.items()}


def calibration_of(name, x, std=ERROR):
    """Return a Calibration with these parameters, SI, a scale factor less 1, and their errors."""
    x, std = (dict(zip(NAMES, numbers, strict=True)) for numbers in (x, std))
    return Calibration(name, EXAMPLE.gravity, *(sensor(s, x, std) for s in SENSORS))


def device(x):
    """Return the device that has these parameters."""
    fitted = calibration_of("d", x)
    matrices = {s: {k: getattr(getattr(fitted, s), k) for k in "TKb"} for s in SENSORS}
    return replace(
        EXAMPLE, **{s: replace(getattr(EXAMPLE, s), **sensor) for s, sensor in matrices.items()}
    )


def record_poses(x, seed, poses):
    """Return the recording of a device with some poses, six faces for a text."""
    if poses == "faces":
        return recording(plan_session(device(x), "six_position"), seed, "six_position")
    return recording(plan_session(device(x), poses=poses - 1, initial_rest_s=10.0), seed)


def calibration(log, prior=None):
    return Calibration(
        "d", EXAMPLE.gravity, *calibrate_recording(log, NOISE, EXAMPLE.gravity, prior)
    )


def values(calibration):
    sensors = [in_nominal_si(s, getattr(calibration, s)) for s in SENSORS]
    return np.concatenate(sensors) - [name.partition(".")[2][0] == "K" for name in NAMES]


def errors(calibration):
    return np.array([getattr(calibration, s).std[n] for s, n, _ in parameters()])


def family(path, count, seed=2):
    """Write family.json of devices of a type, d0 and so on; return their true parameters."""
    rng = np.random.default_rng(seed)
    true = LOT + SPREAD * rng.normal(size=(count, len(NAMES)))
    measured = true + ERROR * rng.normal(size=true.shape)
    members = [
        Member(f"d{k}", calibration_of(f"d{k}", x), NOISE, {}) for k, x in enumerate(measured)
    ]
    write_family(path, {"chip": members})
    return true


def session(folder, kind="multi_position", sha256="0" * 64, **declared):
    """Return a session whose samples are one row, of a log with a hash and declarations."""
    origin = {"sha256": {"log": sha256}, "declared": declared}
    table = pa.table({"t": [0.0]}, metadata={b"imuloop": json.dumps(origin).encode()})
    pq.write_table(table, folder / "samples.parquet")
    return {"poses": {"kind": kind, "samples": folder / "samples.parquet"}}


# six faces determine scale factor and bias of an accelerometer, rests the bias of a gyroscope
LACKING = {"faces": ["accelerometer.T", "gyroscope.T", "gyroscope.K"]}
LACKING[6] = [*LACKING["faces"], "accelerometer.K", "accelerometer.b"]


@seeds(3, 100)
@pytest.mark.parametrize("poses", [6, "faces"])
def test_a_device_that_was_held_out_is_better_with_the_family(seeds, poses, tmp_path):
    """By six poses; the family counts without the device itself, which it holds too."""
    true = family(tmp_path / "family.json", max(seeds, 8))[:seeds]
    before, after, scores = [], [], []
    for k, x in enumerate(true):
        log, prior = (
            record_poses(x, k, poses),
            read_prior(data_sheet(), tmp_path / "family.json", f"d{k}", {}),
        )
        plain, with_family = calibration(log), calibration(log, prior)
        before.append(values(plain) - x)
        after.append(values(with_family) - x)
        scores.append(after[-1] / errors(with_family))
    kinds = np.array([name.rstrip("0123456789") for name in NAMES])
    size = {k: [np.median(np.abs(e)[:, kinds == k]) for e in (before, after)] for k in {*kinds}}
    ratio = {kind: after / before for kind, (before, after) in size.items()}
    assert all(ratio[kind] <= 0.6 for kind in LACKING[poses]), ratio
    # as wide as Student's t of seven devices is
    low = 0.88 if seeds < 100 else 0.94
    assert low <= np.mean(np.abs(scores) < 1.96)


def test_a_family_is_as_wide_as_its_devices_spread(tmp_path):
    true = family(tmp_path / "family.json", 30)
    prior = read_prior(data_sheet(), tmp_path / "family.json", "d0", {})
    mean, std = prior.mean, prior.std
    mean = mean - [name.partition(".")[2][0] == "K" for name in NAMES]
    np.testing.assert_allclose(mean, true[1:].mean(axis=0), atol=ERROR.max())
    wide = true[1:].std(axis=0, ddof=1) * np.sqrt((1 + 1 / 29) * 28 / 26)
    np.testing.assert_allclose(std, wide, rtol=0.05)


def test_too_few_other_devices_are_no_family(tmp_path):
    family(tmp_path / "family.json", 5)
    assert read_prior(data_sheet(), tmp_path / "family.json", "d4", {})
    family(tmp_path / "family.json", 4)
    # the device itself is one of them
    with pytest.raises(ImuloopError, match="fewer than 4 other devices"):
        read_prior(data_sheet(), tmp_path / "family.json", "d3", {})
    prior = read_prior(data_sheet(), tmp_path / "family.json", "other", {})
    assert {*prior.sources.values()} == {str(tmp_path / "family.json")}


def test_an_earlier_calibration_keeps_axes_and_scale_and_the_bias_is_measured_again(tmp_path):
    """By two poses after another switching on; logged in counts before."""
    true, rng = LOT + 0, np.random.default_rng(3)
    earlier = calibration_of("d", true + ERROR * rng.normal(size=len(true)))
    scales = zip(SENSORS, (2e-3, 1e-4), strict=True)
    counts = {s: in_counts(getattr(earlier, s), scale) for s, scale in scales}
    replace(earlier, **counts).to_json(tmp_path / "earlier.json")
    true[BIAS] += [TURN_ON["accelerometer"]] * 3 + [-TURN_ON["gyroscope"]] * 3
    file = str(tmp_path / "earlier.json")
    log, prior = record_poses(true, 4, 2), read_prior(data_sheet(), file, "d", session(tmp_path))
    later = calibration(log, prior)
    away = values(later) - true
    assert (np.abs(away[~BIAS]) < 4 * ERROR[~BIAS]).all()
    assert (errors(later)[~BIAS] <= 1.001 * ERROR[~BIAS]).all()
    assert np.abs(away[BIAS][3:]).max() < 0.1 * TURN_ON["gyroscope"]
    # of an accelerometer along both directions of gravity
    norm = np.linalg.norm(later.accelerometer.apply(log.poses.f), axis=1)
    assert np.abs(norm - EXAMPLE.gravity).max() < 0.1 * TURN_ON["accelerometer"]
    assert {getattr(later, s).prior["source"] for s in SENSORS} == {file}


def test_the_bias_has_the_scatter_of_switching_on_and_what_is_unknown_the_data_sheets(tmp_path):
    earlier = calibration_of("d", LOT)
    accelerometer, gyroscope = earlier.accelerometer, earlier.gyroscope
    cycles = FittedEffect(TurnOnBias(2), dict.fromkeys(TurnOnBias(2).parameters, 0.01), {})
    cycles = replace(cycles, std=dict.fromkeys(cycles.values, 0.0))
    # a gyroscope that only rested
    names, covariance = ("b0", "b1", "b2"), gyroscope.covariance[-3:, -3:]
    sensors = {
        "accelerometer": replace(accelerometer, effects=(cycles,)),
        "gyroscope": replace(
            gyroscope, names=names, covariance=covariance, T=np.eye(3), K=np.ones(3)
        ),
    }
    replace(earlier, **sensors).to_json(tmp_path / "earlier.json")
    prior = read_prior(data_sheet(), tmp_path / "earlier.json", "d", session(tmp_path))
    error = {s: ERROR[[name.startswith(s) for name in NAMES]] for s in SENSORS}
    expected = np.sqrt([2e-4, 2e-4, 2e-4] + error["accelerometer"][-3:] ** 2)
    np.testing.assert_allclose(prior.std[BASE["accelerometer"]][-3:], expected)
    np.testing.assert_allclose(prior.std[BASE["accelerometer"]][:-3], error["accelerometer"][:-3])
    expected = np.hypot(TURN_ON["gyroscope"], error["gyroscope"][-3:])
    np.testing.assert_allclose(prior.std[BASE["gyroscope"]], [*[0.02] * 6, *[0.03] * 3, *expected])


def damage(content, *keys, value):
    """Return the content of a JSON file with another value at keys."""
    *above, last = keys
    place = content
    for key in above:
        place = place[key]
    place[last] = value
    return content


FIXED = {"names": ["K0", "K1"], "matrix": [[1e-8, 0], [0, 0]]}
PARAMETER = ("types", "chip", "parameters", "gyroscope.K1")
# a file, made of earlier.json and family.json, declarations of the device, and the message
WRONG = {
    "no file": (lambda c, f: None, {}, "cannot be read: No such file or directory"),
    "no JSON": (lambda c, f: "t,ax,ay", {}, "no JSON: "),
    "noise.json": (lambda c, f: NOISE.to_dict(), {}, "neither a calibration.json nor a family"),
    "a later format": (lambda c, f: c | {"format": 9}, {}, "format 9, this version reads format"),
    "no sensor": (
        lambda c, f: damage(c, "accelerometer", "K", value=[1e-9, 1, 1]), {}, "accelerometer: K0"
    ),
    "nothing measured": (
        lambda c, f: c | {s: nominal.to_dict() for s, nominal in NOMINAL.items()},
        {},
        "nothing was measured there",
    ),
    "the same log": (
        lambda c, f: c | {"sha256": ["1" * 64]}, {"sha256": "1" * 64}, "would count twice"
    ),
    "other axes": (
        lambda c, f: c | {"log": {"columns": {"acceleration": ["-ay", "ax", "az"]}}},
        {"columns": {"acceleration": ["ax", "ay", "az"]}},
        "its axes are others: columns.acceleration was [-ay, ax, az] and is [ax, ay, az]",
    ),
    "no error": (lambda c, f: damage(c, "gyroscope", "covariance", value=FIXED), {}, "singular"),
    "no number": (lambda c, f: damage(f, *PARAMETER, "std", 0, value=0), {}, "damaged: gyroscope"),
    "two types": (
        lambda c, f: {"types": f["types"] | {"other": {}}}, {}, "of which type, chip or other?"
    ),
    "another type": (
        lambda c, f: f, {"type": "chop"}, "there is no type 'chop'; did you mean 'chip'?"
    ),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_a_file_that_gives_no_prior_is_one_line(wrong, tmp_path):
    harm, how, said = WRONG[wrong]
    calibration_of("d", LOT).to_json(tmp_path / "calibration.json")
    family(tmp_path / "family.json", 5)
    both = (json.loads((tmp_path / f"{n}.json").read_text()) for n in ("calibration", "family"))
    path, content = tmp_path / "prior.json", harm(*both)
    if content is not None:
        path.write_text(content if isinstance(content, str) else json.dumps(plain(content)))
    how = dict(how)
    type = how.pop("type", None)
    with pytest.raises(ImuloopError) as error:
        read_prior(data_sheet(), path, "d", session(tmp_path, **how), type)
    line = str(error.value)
    assert line.startswith(f"prior: {path}: ") and "\n" not in line and said in line
    assert line.count(str(path)) == 1


def test_a_night_for_the_noise_may_be_in_both(tmp_path):
    replace(calibration_of("d", LOT), sha256=("0" * 64,)).to_json(tmp_path / "earlier.json")
    assert read_prior(data_sheet(), tmp_path / "earlier.json", "d", session(tmp_path, "static"))
