"""profiles/kubernetes as far as it can be checked without a cluster: the plan of a run."""

import os

import pytest

from cluster.conftest import KEYS, into_bucket, run, write_config, write_devices

PLUGIN = "build/kubernetes"


def test_a_run_on_kubernetes_is_planned(repository, s3, tmp_path):
    if not (repository / PLUGIN / "snakemake_executor_plugin_kubernetes").is_dir():
        pytest.skip(f"no Kubernetes plugin in {PLUGIN}: .ci/cluster installs it")
    client, environment = s3
    devices = write_devices(tmp_path, ["imu"])
    into_bucket(client, tmp_path, devices, "imuloop")
    write_config(tmp_path, devices)
    profile = ["--profile", repository / "profiles/kubernetes", "-n"]
    paths = os.pathsep.join([str(repository / PLUGIN), os.environ.get("PYTHONPATH", "")])
    done = run(repository, tmp_path, *profile, **environment | KEYS, PYTHONPATH=paths)
    assert done.returncode == 0, done.stderr
    # a device is one pod, logs and results are in the storage, the report is made here
    said = done.stdout + done.stderr
    assert said.count("Group job device") == 1
    assert "s3://imuloop/imu_static.csv" in said
    assert "output: s3://imuloop/results/report.html (send to storage)" in said
