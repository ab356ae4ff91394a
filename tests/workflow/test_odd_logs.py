"""Logs that are odd but can be read: each stage has a result, and every number is one."""

import numpy as np
import pandas as pd
import pytest

from imuloop import chain
from imuloop.core.samples import ACCELERATION, CHANNELS
from imuloop.report.report import write_report
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from quick import hurry
from report.build import PROVENANCE
from soundness import faults_of


@pytest.fixture
def faults(tmp_path):
    """Return a function: the faults of the results of logs by name, of kinds by name."""

    def of(**logs):
        results = tmp_path / "results"
        kinds = {name: kind for name, (kind, _) in logs.items()}
        device = chain.Device("imu", results / "imu", kinds)
        for name, (_, table) in logs.items():
            table.to_parquet(tmp_path / f"{name}.parquet")
            chain.ingest(device, name, {}, [tmp_path / f"{name}.parquet"], reject=True)
        with hurry("imu"):
            chain.run(device)
        paths = results / "report.html", results / "comparison.csv"
        write_report([results / "imu"], PROVENANCE, *paths)
        assert len([*results.rglob("*.json")]) > 8
        return [*faults_of(results)]

    return of


def test_axes_without_noise_have_no_allan_curve_and_are_drawn_beside_others(logs, faults):
    # means of the log, held; and a thermometer without a value
    still = logs["static"].assign(temperature=np.nan)
    still[list(CHANNELS)] = still[list(CHANNELS)].mean().to_numpy()
    still.loc[len(still) // 2 :, "ax"] += 0.1
    log = logs["static"].assign(gx=-0.0276, gy=0.0)
    log.loc[len(log) // 3 :, "gz"] = 0.0
    assert faults(a=("static", still), b=("static", log), c=("six_position", log)) == []


@pytest.mark.study
@pytest.mark.usefixtures("blank_figures")
def test_padding_is_no_rest_and_one_sample_far_too_large_costs_one(logs, faults, tmp_path):
    whole = logs["multi_position"]
    padded, spoilt, third = whole.copy(), whole.copy(), len(whole) // 3
    padded.loc[third : third + 500, list(CHANNELS)] = 0.0
    spoilt.loc[300, "ay"] = 1e9
    tables = {"padded": padded, "spoilt": spoilt}
    assert faults(**{name: ("multi_position", log) for name, log in tables.items()}) == []
    found = {"whole": segment_session(whole, "multi_position", SegmentSettings())[0]}
    for name in tables:
        found[name] = pd.read_parquet(tmp_path / f"results/imu/{name}/segments.parquet")
    rests = {name: table[table["kind"] == "static"] for name, table in found.items()}
    force = np.linalg.norm(rests["padded"][[f"{axis}_mean" for axis in ACCELERATION]], axis=1)
    assert len(force) > 8 and (force > 9).all()
    assert len(rests["whole"]) >= 12 and abs(len(rests["spoilt"]) - len(rests["whole"])) <= 1
