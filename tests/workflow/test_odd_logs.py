"""Logs that are odd but can be read: each stage has a result, and every number is one."""

import numpy as np
import pytest

from imuloop import chain
from imuloop.core.samples import CHANNELS
from imuloop.report.report import write_report
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
    assert faults(a=("static", still), b=("six_position", log)) == []
