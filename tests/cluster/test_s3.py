"""Logs in an S3, a local one: the results of the local files."""

import re
import shlex

import pyarrow.parquet as pq
import pytest

from cluster.conftest import (
    KEYS,
    contents,
    into_bucket,
    needs_plugin,
    run,
    write_config,
    write_devices,
)

FOLDER = b"s3://logs/bench 1/"
TARGET = "results/imu/noise.json"


@pytest.fixture(scope="module")
def both_runs(repository, s3, tmp_path_factory):
    """A device run on local files, and on the same ones in the S3."""
    client, environment = s3
    here, there = (tmp_path_factory.mktemp(name) for name in ("here", "there"))
    devices = write_devices(here, ["imu"])
    done = run(repository, here, "-c2", target=TARGET)
    assert done.returncode == 0, done.stderr
    into_bucket(client, here, devices, "logs", "bench 1/")
    write_config(there, devices)
    done = run(repository, there, "-c2", target=TARGET, **environment | KEYS)
    assert done.returncode == 0, done.stderr
    return here, there


def test_a_log_in_s3_gives_the_results_of_the_local_file(both_runs):
    local, remote = (contents(folder / "results") for folder in both_runs)
    assert set(local) == set(remote)
    for path in local:
        if path.endswith("samples.parquet"):
            tables = [pq.read_table(folder / "results" / path) for folder in both_runs]
            assert tables[0].equals(tables[1])
            mine, other = (table.schema.metadata[b"imuloop"] for table in tables)
            assert other.replace(FOLDER, b"") == mine
        else:
            # to the byte, but for the address, where the record names the source
            assert remote[path].replace(FOLDER, b"") == local[path], path


def test_a_log_that_is_not_there_is_named(repository, s3, tmp_path):
    address = "s3://logs/none.csv"
    write_config(tmp_path, {"imu": {"sessions": {"rest": {"kind": "static", "file": address}}}})
    done = run(repository, tmp_path, "-n", target=TARGET, **s3[1] | KEYS)
    assert done.returncode == 1 and address in done.stdout + done.stderr


def test_every_command_of_the_document_can_be_planned(repository, both_runs, s3):
    needs_plugin("executor_plugin_slurm")
    text = (repository / "docs/clusters.md").read_text()
    lines = re.findall(r"^\.venv-cluster/bin/snakemake (.*) -- results/report.html$", text, re.M)
    assert len(lines) == text.count("\n.venv-cluster/bin/snakemake ") == 3
    for line in lines:
        words = shlex.split(line.replace("--configfile config.yaml", ""))
        words = [repository / w if w.startswith("profiles/") else w for w in words]
        done = run(repository, both_runs[1], *words, "-n", **s3[1] | KEYS)
        assert done.returncode == 0, f"{line}\n{done.stderr}"
