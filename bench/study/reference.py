"""Devices beside a reference: is what nobody declared found, at one detection limit and three?"""

from collections import Counter, defaultdict
from dataclasses import replace
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np
import pandas as pd

from bench.study.chain import ATTITUDE, LIMITS, through
from bench.study.keep import kept
from bench.tables import commit, share, table
from imuloop import chain
from imuloop.chain import Device
from imuloop.core.files import read_json
from imuloop.core.model import Calibration
from imuloop.simulate.reference import Beside, simulate_beside
from imuloop.validate.attitude import no_attitude

DECLARED = {
    "columns": {
        "time": "t",
        "orientation": ["qw", "qx", "qy", "qz"],
        "position": ["px", "py", "pz"],
    },
    "units": {},
    "convention": "body_to_world",
}
# what is put in at a time, one effect of each sensor: they are fitted apart
PAIRS = (
    {"gyroscope": "time_offset", "accelerometer": "time_offset"},
    {"gyroscope": "clock_drift", "accelerometer": "lever_arm"},
    {"gyroscope": "g_sensitivity"},
)
SENSORS = ("accelerometer", "gyroscope")


def base(seed):
    """Return a device with T and K of a cheap part, and nothing else."""
    rng = np.random.default_rng([seed, 1])
    T = {"gyroscope": np.eye(3) + (1 - np.eye(3)) * rng.normal(0, 0.004, (3, 3))}
    T["accelerometer"] = np.eye(3) + np.triu(rng.normal(0, 0.004, (3, 3)), 1)
    return Beside(T=T, K={s: 1 + rng.normal(0, 0.004, 3) for s in SENSORS})


def diagnosed(
    truth, seed, limits=True, declared=DECLARED, change=None, log_change=None, sessions=1
):
    """Return diagnosis.json (None where the log was rejected), quality.json and calibration.

    `change` and `log_change` take the columns of the reference and of the log, and harm them; of
    several sessions each moves and rests in its own way.
    """
    none = no_attitude("study", "not asked for")
    with TemporaryDirectory() as folder, patch(ATTITUDE, return_value=none):
        folder, names = Path(folder), [f"hand_{k}" for k in range(sessions)]
        kinds = dict.fromkeys(names, "reference_motion")
        device = Device("study", folder, kinds, gravity=truth.gravity)
        for k, session in enumerate(names):
            paths = [folder / f"{session}_{role}.parquet" for role in ("log", "reference")]
            tables = simulate_beside(truth, [seed, k] if k else seed)
            for path, columns, harm in zip(paths, tables, (log_change, change), strict=True):
                table = harm(columns) if harm else columns
                pd.DataFrame(table).to_parquet(path, index=False)
            sources = {
                role: {"path": str(path)}
                for role, path in zip(("log", "reference"), paths, strict=True)
            }
            told = {"reference": declared, "sources": sources, "columns": {"time": "t"}}
            chain.ingest_or_reject(device, session, told, paths)
            quality = read_json(folder / session / "quality.json")
            if quality["status"] != "ok":
                return None, quality, None
        with patch(LIMITS, return_value={}) if not limits else patch(ATTITUDE, return_value=none):
            through(device)
        calibration = Calibration.from_json(folder / "calibration.json")
        return read_json(folder / "diagnosis.json"), quality, calibration


def put_in(truth, sensor, name, values):
    """Return a device with an effect, of parameters by name."""
    if name == "time_offset":
        return replace(truth, dt=truth.dt | {sensor: values["dt"]})
    if name == "clock_drift":
        return replace(truth, drift=values["d"])
    if name == "lever_arm":
        arm = [[values.get(f"r{k}", values.get(f"r{i}{k}", 0.0)) for k in "xyz"] for i in "xyz"]
        return replace(truth, arm=np.array(arm))
    G = [[values.get(f"G{i}{j}", 0.0) for j in range(3)] for i in range(3)]
    return replace(truth, G=np.array(G))


def study(seed, made_of):
    """Return what a seed's devices gave.

    ``rows`` of what was asked: size, sensor, effect put in, effects found, values put in; and
    ``pulls`` of parameters, in standard errors.
    """
    truth, rows, pulls = base(seed), [], []
    control, _, calibration = diagnosed(truth, seed)
    rng = np.random.default_rng([seed, 2])
    for sensor in SENSORS:
        found = control["sensors"][sensor]["reference"]
        rows.append(("control", sensor, "", [e["name"] for e in found["effects"]], None))
        own, known = getattr(calibration, sensor), truth.K[sensor]
        written = [k for k in range(3) if f"K{k}" in own.std]
        pulls += [(own.K[k] - known[k]) / own.std[f"K{k}"] for k in written]
    for pair, size in product(PAIRS, (1.0, 3.0)):
        device, put = truth, {}
        for sensor, name in pair.items():
            candidates = control["sensors"][sensor]["reference"]["candidates"]
            limit = next(c for c in candidates if c["name"] == name)["detection_limit"]
            if not limit:
                continue
            parameter = rng.choice(sorted(limit))
            put[sensor] = {parameter: size * limit[parameter] * rng.choice([-1, 1])}
            device = put_in(device, sensor, name, put[sensor])
        found, *_ = diagnosed(device, seed, limits=False)
        for sensor, values in put.items():
            effects = found["sensors"][sensor]["reference"]["effects"]
            names = [e["name"] for e in effects]
            rows.append((f"{size:g} limits", sensor, pair[sensor], names, values))
            for effect in effects:
                if effect["name"] == pair[sensor]:
                    pulls += [
                        (v - values.get(k, 0.0)) / effect["std"][k]
                        for k, v in effect["parameters"].items()
                    ]
    return {"seed": seed, "commit": made_of, "rows": rows, "pulls": pulls}


def run(first, seeds, workers, keep=None, make=True):
    """Return the outcomes of seeds, each written into the folder `keep` when it is made."""
    jobs = [(keep, make, seed, commit()) for seed in range(first, first + seeds)]
    with get_context("fork").Pool(workers) as pool:
        return [outcome for outcome in pool.imap(_seed, jobs) if outcome]


def _seed(job):
    keep, make, seed, made_of = job
    return kept(keep, f"reference_{seed}", study if make else None, seed, made_of)


def document(outcomes, first):
    """Return how often each was found, what else was, and how good the intervals are."""
    asked, found, odd = Counter(), Counter(), []
    more = defaultdict(list)
    for outcome in outcomes:
        for size, sensor, name, names, values in outcome["rows"]:
            key = size, sensor, name or "nothing"
            extra = [n for n in names if n != name]
            asked[key] += 1
            found[key] += name in names
            more[size].append(bool(extra))
            if extra or (name and name not in names):
                odd.append(f"- seed {outcome['seed']}: {', '.join(key)} {values}: {names}")
    rows = [(*key, share(found[key], n)) for key, n in sorted(asked.items()) if key[2] != "nothing"]
    for size in more:
        keys = [key for key in asked if key[0] == size and key[2] != "nothing"]
        if keys:
            whole = share(sum(found[k] for k in keys), sum(asked[k] for k in keys))
            rows.append((size, "both", "all", whole))
    rows += [(s, "both", "something else", share(sum(m), len(m))) for s, m in more.items()]
    inside = np.abs([pull for outcome in outcomes for pull in outcome["pulls"]]) < 1.96
    return "\n\n".join(
        (
            f"Beside a reference, {len(outcomes)} seeds from {first} on.",
            table(("size", "sensor", "effect", "found"), rows),
            f"95 % intervals hold the truth: {share(sum(inside), len(inside))}.",
            "\n".join(odd),
        )
    )
