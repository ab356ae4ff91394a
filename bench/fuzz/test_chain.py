"""Harmed stretches of recordings through the whole chain: is every result of each sound?

``pytest bench/fuzz/test_chain.py --cases 100``: so many of each device, recordings by
IMULOOP_MIRROR. A case is sound if all result files are there, fit their schemas in workflow/schemas
and hold nothing but numbers, and the report is well-formed.
"""

import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, note
from hypothesis import strategies as st

from bench.fuzz.harms import HARMS
from bench.measured import devices, ingested, missing
from bench.tables import REPOSITORY
from imuloop.core import units
from imuloop.core.samples import SENSORS
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import read_truth
from soundness import judge

# of a case, s of processor time; rows of a log: a case is to take a second or two
SECONDS, ROWS = 60, 8000
SIMULATED = ("iphone_6", "ipad_pro")
KINDS = ("static", "six_position", "multi_position")
UNITS = {"acceleration": units.ACCELERATION, "angular_rate": units.ANGULAR_RATE}
COUNT = {"acceleration": 1e-3, "angular_rate": 1e-4}


@cache
def recordings(name):
    """Return the sessions of a device as tables, SI; skip what is not at hand."""
    if name in SIMULATED:
        truth = read_truth(REPOSITORY / f"data/replicas/{name}.yaml")
        return [simulate_session(truth, "multi_position")]
    if reason := missing(name):
        pytest.skip(reason)
    with tempfile.TemporaryDirectory() as folder:
        made = ingested(name, Path(folder))
        return [pd.read_parquet(files["samples"]) for files in made.sessions.values()]


@st.composite
def sessions(draw, name):
    """One or two logs with up to four harms, written in units that may not be those declared."""
    made = []
    for _ in range(draw(st.integers(1, 2))):
        whole = draw(st.sampled_from(recordings(name)))
        first = draw(st.integers(0, max(len(whole) - ROWS, 0)))
        thin = draw(st.sampled_from([1, -(-len(whole) // ROWS)]))
        log = whole[::thin] if thin > 1 else whole[first : first + ROWS]
        log = log.assign(t=log.t - log.t.iloc[0]).reset_index(drop=True)
        harms = draw(st.lists(st.sampled_from(HARMS), max_size=4))
        for harm in harms:
            if len(log):
                with np.errstate(all="ignore"):
                    log = harm(log, draw(st.randoms())).reset_index(drop=True)
        written = {q: draw(st.sampled_from([*each, "count"])) for q, each in UNITS.items()}
        declared = dict(written)
        if draw(st.integers(0, 9)) == 0:
            declared["acceleration"] = draw(st.sampled_from([*UNITS["acceleration"], "count"]))
        kind = draw(st.sampled_from(KINDS))
        note(f"{kind}, {written} as {declared}: {[harm.__name__ for harm in harms]}")
        made.append((kind, log, written, declared, draw(st.sampled_from(["csv", "parquet"]))))
    return made


def entry(made):
    """Write logs into the current folder and return the device in a config."""
    written_as = {}
    for number, (kind, log, written, declared, ending) in enumerate(made):
        for quantity, axes in zip(UNITS, SENSORS.values(), strict=True):
            scale = COUNT[quantity]
            if written[quantity] != "count":
                scale = UNITS[quantity][written[quantity]]
            log = log.assign(**{axis: log[axis] / scale for axis in axes})
        path = Path(f"log_{number}.{ending}").resolve()
        log.to_csv(path, index=False) if ending == "csv" else log.to_parquet(path, index=False)
        written_as[f"session_{number}"] = {"kind": kind, "file": str(path), "units": declared}
    nominal = {quantity: {"scale": scale, "offset": 0.0} for quantity, scale in COUNT.items()}
    return {"nominal": nominal, "sessions": written_as}


@pytest.mark.parametrize("name", [*SIMULATED, *devices()])
@given(data=st.data())
def test_every_result_of_a_harmed_recording_is_sound(confined, name, data):
    made = data.draw(sessions(name))
    with confined(SECONDS) as folder, np.errstate(all="ignore"):
        faults = judge(entry(made), folder / "results")
    assert faults == []
