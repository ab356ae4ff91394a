"""A run that is killed at any moment and run again ends with the results of a calm run."""

import pytest

from bench.kill import kills


@pytest.mark.study
def test_killed_runs_end_with_the_results_of_a_calm_one(checkout, tmp_path):
    target = "results/imu/static/segments.parquet"
    assert kills(checkout, tmp_path, count=1, seed=1, target=target) >= 1
