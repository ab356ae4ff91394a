"""Logs in an S3, a local one: the results of the local files, and one line where one is missing."""

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
TARGET = "results/imu/section.html"
# results and benchmarks in the S3 too, as on machines that share no disk
STORAGE = ["--default-storage-provider", "s3", "--default-storage-prefix", "s3://all"]
STORAGE += ["--shared-fs-usage", "persistence", "software-deployment", "sources", "source-cache"]


@pytest.fixture(scope="module")
def both(repository, s3, tmp_path_factory):
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
        ("s3://other/none.csv", KEYS, "there is no bucket other, or it is not"),
        ("s3://logs/none.csv", {}, "cannot be looked up: Unable to locate credentials"),
        ("gs://logs/none.csv", {}, "Snakemake has no plugin for gs:// here; see docs/clusters.md"),
    ],
)
def test_what_is_missing_is_reported_in_one_line_before_any_job(
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
    limit = ("--resources", "mem_mb=100000")
    planned = run(repository, tmp_path, "-n", *limit, target=TARGET, **environment | KEYS).stdout
    # 750 MB and 700 for each GB of log
    assert re.search(r"rule noise:\n(?: .*\n)*? +resources: .*mem_mb=764,", planned)


def test_a_run_without_any_shared_folder_gives_the_same_bytes(both, repository, s3, tmp_path):
    _, there, _ = both
    client, environment = s3
    client.create_bucket(Bucket="all")
    (tmp_path / "config.yaml").write_bytes((there / "config.yaml").read_bytes())
    done = run(repository, tmp_path, "-c2", *STORAGE, target=TARGET, **environment | KEYS)
    assert done.returncode == 0, done.stderr
    listed = client.list_objects_v2(Bucket="all", Prefix="results/")["Contents"]
    local = contents(there)
    assert {each["Key"] for each in listed} == set(local)
    for path in local:
        assert client.get_object(Bucket="all", Key=path)["Body"].read() == local[path], path


@pytest.fixture
def stored(repository, s3, tmp_path):
    """Return a function: plan a run of a device whose logs are in a bucket."""
    client, environment = s3
    devices = write_devices(tmp_path, ["imu"])
    into_bucket(client, tmp_path, devices, "bucket")
    write_config(tmp_path, devices)

    def plan(*arguments, **more):
        arguments = [repository / a if str(a).startswith("profiles/") else a for a in arguments]
        done = run(repository, tmp_path, *arguments, "-n", **environment | KEYS | more)
        assert done.returncode == 0, f"{arguments}\n{done.stderr}"
        return done.stdout + done.stderr

    return plan


def test_every_command_of_the_document_can_be_planned(repository, stored):
    needs_plugin("executor_plugin_slurm")
    text = (repository / "docs/clusters.md").read_text()
    lines = re.findall(r"^\.venv-cluster/bin/snakemake (.*) -- results/report.html$", text, re.M)
    assert len(lines) == text.count("\n.venv-cluster/bin/snakemake ") == 3
    for line in lines:
        stored(*shlex.split(line.replace("--configfile config.yaml", "")))


# requests for each device with two logs, as counted: of a plan, of a run that fetches them, and of
# one that has its results in the S3 too
PLANNED, RUN, STORED = 8, 12, 260


@pytest.mark.parametrize(
    ("how", "most"),
    [
        (["-n"], PLANNED),
        (["-c2", "--until", "segment"], RUN),
        (["-c2", "--until", "segment", *STORAGE], STORED),
    ],
    ids=["plan", "run", "stored"],
)
def test_the_storage_is_asked_the_same_few_times_for_each_device(
    repository, s3, tmp_path, caplog, how, most
):
    client, environment = s3
    counts = []
    for number in (2, 4):
        folder = tmp_path / str(number)
        folder.mkdir()
        devices = write_devices(folder, [f"imu_{i}" for i in range(number)])
        into_bucket(client, folder, devices, f"counted{len(how)}-{number}")
        write_config(folder, devices)
        results = f"s3://results-{number}"
        client.create_bucket(Bucket=f"results-{number}")
        caplog.clear()
        with caplog.at_level("INFO", logger="werkzeug"):
            words = [word.replace("s3://all", results) for word in how]
            done = run(repository, folder, *words, **environment | KEYS)
        assert done.returncode == 0, done.stderr
        counts.append(len(caplog.records))
    assert 0 < counts[1] - counts[0] <= 2 * most
