"""A gyroscope that hangs in a log: repeated samples are a gap, not a rest, a turn or its noise."""

import numpy as np
import pandas as pd
import pytest

from bench.realistic.device import CHANNELS, record
from imuloop import chain
from imuloop.calibrate.sessions import read_recording
from imuloop.core.samples import read_columns, read_metadata


@pytest.mark.parametrize("hangs", [False, True])
def test_what_a_gyroscope_repeats_is_a_gap(hangs, tmp_path):
    device_log = record(13, "clean")
    log, rests = pd.DataFrame(device_log.columns), device_log.rests
    start, end = rests[6, 1] - 2, rests[7, 0] + 2
    if hangs:
        first, last = np.searchsorted(log["t"], [start, end])
        log.loc[first:last, CHANNELS[3:]] = log.loc[first, CHANNELS[3:]].to_numpy()
    log.to_csv(tmp_path / "log.csv", index=False)
    device = chain.Device("hung", tmp_path / "hung", {"poses": "multi_position"})
    chain.ingest(device, "poses", {}, [tmp_path / "log.csv"])
    chain.segment(device)
    files = device.sessions["poses"]
    spans = np.reshape(read_metadata(files["samples"]).get("stuck", []), (-1, 2))
    assert spans == pytest.approx(np.reshape([[start, end]] * 3 * hangs, (-1, 2)), abs=0.02)
    table = pd.DataFrame(read_columns(files["segments"]))
    gaps = table.loc[table["kind"] == "gap", ["start_s", "end_s"]].to_numpy()
    assert gaps == pytest.approx(np.reshape([[start, end]] * hangs, (-1, 2)), abs=0.03)
    # every instant lies in one row
    assert np.array_equal(table["start_s"][1:], table["end_s"][:-1])
    still = table.loc[table["kind"] == "static", ["start_s", "end_s"]].to_numpy()
    assert len(still) == len(rests)
    # no rest reaches into a move
    assert np.all(still[:, 0] > rests[:, 0] - 0.1) and np.all(still[:, 1] < rests[:, 1] + 0.1)
    recording = read_recording(device.sessions, 30.0)
    first = recording.rotations.first.tolist()
    assert first == [k for k in range(len(rests) - 1) if not (hangs and k == 6)]
