"""Devices to run, a SLURM of this machine and an S3 on it; a skip names the missing programs."""

import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import example_truth

SLURM = Path(__file__).with_name("slurm")
# account of the local S3
KEYS = {"AWS_ACCESS_KEY_ID": "any", "AWS_SECRET_ACCESS_KEY": "any"}


def needs_plugin(name):
    if importlib.util.find_spec(f"snakemake_{name}") is None:
        pytest.skip(f"snakemake_{name} is not installed here: make cluster")


def write_devices(folder, names):
    """Write the logs of small devices, a static and a multi-position one each, and their config."""
    truth = example_truth(rate=50.0)
    static, poses = (truth.sessions[kind] for kind in ("static", "multi_position"))
    short = {"poses": 12, "initial_rest_s": 10.0, "rest_s": (2.0, 3.0)}
    plans = {"static": replace(static, duration_s=60.0), "multi_position": replace(poses, **short)}
    truth, devices = replace(truth, sessions=plans), {}
    for seed, name in enumerate(names):
        for kind in plans:
            write_log(folder / f"{name}_{kind}.csv", simulate_session(truth, kind, seed), {})
        sessions = {kind: {"kind": kind, "file": f"{name}_{kind}.csv"} for kind in plans}
        devices[name] = {"sessions": sessions}
    write_config(folder, devices)
    return devices


def write_config(folder, devices, name="config.yaml"):
    (folder / name).write_text(yaml.safe_dump({"devices": devices}))


def into_bucket(client, folder, devices, bucket, prefix=""):
    """Put the logs of devices into a bucket, made if need be, and name them there."""
    client.create_bucket(Bucket=bucket)
    for device in devices.values():
        for session in device["sessions"].values():
            key = prefix + session["file"]
            client.upload_file(folder / session["file"], bucket, key)
            session["file"] = f"s3://{bucket}/{key}"


def run(repository, folder, *arguments, target="results/report.html", **environment):
    """Run the workflow in a folder, as a user does; return the finished process."""
    words = [sys.executable, "-m", "snakemake", "-s", repository / "Snakefile", "-d", folder]
    words += ["--configfile", "config.yaml", *arguments, "--", *target.split()]
    return subprocess.run(
        list(map(str, words)),
        **{"cwd": folder, "env": os.environ | environment, "capture_output": True, "text": True},
    )


def contents(folder):
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.fixture(scope="session")
def slurm():
    """A SLURM of one node; the name of Snakemake's profile for it."""
    needs_plugin("executor_plugin_slurm")
    lacking = [
        name for name in ("munged", "slurmctld", "slurmd", "sbatch") if not shutil.which(name)
    ]
    if lacking:
        pytest.skip(f"no {', '.join(lacking)} here: .ci/cluster installs SLURM")
    if os.getuid():
        pytest.skip("only root starts a SLURM: its daemons change users")
    if Path("/etc/slurm/slurm.conf").exists():
        pytest.skip("/etc/slurm/slurm.conf is there: this machine has its own SLURM")
    # munge wants a folder that all may enter, which pytest's are not
    with tempfile.TemporaryDirectory(prefix="imuloop-slurm-") as folder:
        try:
            subprocess.run([SLURM, "start", folder], check=True)
            yield "profiles/slurm"
        finally:
            subprocess.run([SLURM, "stop", folder], check=True)


@pytest.fixture(scope="session")
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
    # only credentials of the test: no file of the user, no machine that lends a role
    nothing = dict.fromkeys(("AWS_SHARED_CREDENTIALS_FILE", "AWS_CONFIG_FILE"), os.devnull)
    yield client, nothing | {"AWS_ENDPOINT_URL": address, "AWS_EC2_METADATA_DISABLED": "true"}
    started.stop()
