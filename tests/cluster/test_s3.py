"""Logs in an S3, a local one: the results of the local files, and one line where one is missing."""

import os
import re

import pyarrow.parquet as pq
import pytest

from cluster.conftest import contents, needs_plugin, run, write_config, write_devices

KEYS = {"AWS_ACCESS_KEY_ID": "any", "AWS_SECRET_ACCESS_KEY": "any"}
FOLDER = b"s3://logs/bench 1/"
TARGET = "results/imu/section.html"


@pytest.fixture(scope="module")
def s3():
    """An S3 on this machine: its client and its address as the environment gives it."""
    needs_plugin("storage_plugin_s3")
    boto3 = pytest.importorskip("boto3")
    server = pytest.importorskip("moto.server", reason="no moto here: make cluster")
    started = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    started.start()
    host, port = started.get_host_and_port()
    address = f"http://{host}:{port}"
    names = {"aws_access_key_id": "any", "aws_secret_access_key": "any"}
    client = boto3.client("s3", endpoint_url=address, region_name="us-east-1", **names)
    client.create_bucket(Bucket="logs")
    # none but what a test gives: no file of the user's, no machine that lends a role
    nothing = dict.fromkeys(("AWS_SHARED_CREDENTIALS_FILE", "AWS_CONFIG_FILE"), os.devnull)
    yield client, nothing | {"AWS_ENDPOINT_URL": address, "AWS_EC2_METADATA_DISABLED": "true"}
    started.stop()


@pytest.fixture(scope="module")
def both(repository, s3, tmp_path_factory):
    """A device run on local files, and on the same ones in the S3."""
    client, environment = s3
    here, there = (tmp_path_factory.mktemp(name) for name in ("here", "there"))
    devices = write_devices(here, ["imu"])
    done = run(repository, here, "-c2", target=TARGET)
    assert done.returncode == 0, done.stderr
    for session in devices["imu"]["sessions"].values():
        client.upload_file(here / session["file"], "logs", f"bench 1/{session['file']}")
        session["file"] = f"s3://logs/bench 1/{session['file']}"
    write_config(there, devices)
    done = run(repository, there, "-c2", target=TARGET, **environment | KEYS)
    assert done.returncode == 0, done.stderr
    return here, there, done


def test_a_log_in_s3_gives_the_results_of_the_local_file(both):
    here, there, _ = both
    local, remote = contents(here), contents(there)
    assert set(local) == set(remote)
    for path in local:
        if path.endswith("samples.parquet"):
            tables = [pq.read_table(folder / path) for folder in (here, there)]
            assert tables[0].equals(tables[1])
            mine, other = (table.schema.metadata[b"imuloop"] for table in tables)
            assert other.replace(FOLDER, b"") == mine
        else:
            # to the byte, but for the address, where the record says what was read
            assert remote[path].replace(FOLDER, b"") == local[path], path


def test_a_log_in_s3_is_looked_at_no_more_once_its_results_are_there(both, repository, s3):
    _, there, _ = both
    done = run(repository, there, "-n", target=TARGET, **s3[1] | KEYS)
    assert "Nothing to be done" in done.stdout + done.stderr


@pytest.mark.parametrize(
    ("address", "keys", "fault"),
    [
        ("s3://logs/none.csv", KEYS, "there is no such file in the storage"),
        (
            "s3://other/none.csv",
            KEYS,
            "there is no bucket other, or it is not",
        ),
        ("s3://logs/none.csv", {}, "cannot be looked up: Unable to locate credentials"),
        ("gs://logs/none.csv", {}, "Snakemake has no plugin for gs:// here; see docs/clusters.md"),
    ],
)
def test_what_is_missing_is_told_in_one_line_before_any_job(
    repository, s3, tmp_path, address, keys, fault
):
    write_config(tmp_path, {"imu": {"sessions": {"rest": {"kind": "static", "file": address}}}})
    done = run(repository, tmp_path, "-c1", target=TARGET, **s3[1] | keys)
    assert done.returncode == 1
    lines = [line for line in done.stderr.splitlines() if address in line]
    assert lines == [line for line in done.stderr.splitlines() if "config.yaml:" in line]
    assert lines[0].startswith(f"config.yaml: devices.imu.sessions.rest.file: {address}: {fault}")
    assert "Traceback" not in done.stderr


def test_memory_is_asked_for_by_the_size_in_the_storage(repository, s3, tmp_path):
    client, environment = s3
    client.put_object(Bucket="logs", Key="large.csv", Body=bytes(20_000_000))
    log = {"kind": "static", "file": "s3://logs/large.csv"}
    write_config(tmp_path, {"imu": {"sessions": {"rest": log}}})
    planned = run(repository, tmp_path, "-n", target=TARGET, **environment | KEYS).stdout
    # 500 MB and 700 for each GB of log
    assert re.search(r"rule noise_1:\n(?: .*\n)*? +resources: .*mem_mb=514,", planned)
