"""The workflow on a SLURM of one node: same bytes, a submission a device, failures reported."""

import re
import subprocess
import sys

import pytest

from cluster.conftest import contents, run, write_devices
from workflow.conftest import copy_checkout

# lines added to the script of the segmentation
HARM = """
if device.name == "broken":
    raise RuntimeError("on purpose")
"""
TARGET = "results/good/noise.json results/broken/noise.json"
QUICK = ["--retries", "0", "--slurm-init-seconds-before-status-checks", "2"]
QUICK += ["--seconds-between-status-checks", "2", "--latency-wait", "5"]
KEPT = "--slurm-keep-successful-logs"
# what squeue is asked for: cores, memory and state, and where the job was submitted
ASKED = "%C|%m|%T|%Z"


@pytest.fixture(scope="module")
def checkout(repository, tmp_path_factory):
    """A copy of the workflow in which one device fails."""
    edited = copy_checkout(repository, tmp_path_factory.mktemp("checkout"))
    with open(edited / "scripts/segment.py", "a") as script:
        script.write(HARM)
    return edited


@pytest.fixture(scope="module")
def local_results(checkout, tmp_path_factory):
    """The results of the good device on this machine."""
    folder = tmp_path_factory.mktemp("here")
    write_devices(folder, ["good", "broken"])
    done = run(checkout, folder, "-c2", target="results/good/noise.json")
    assert done.returncode == 0, done.stderr
    return contents(folder / "results/good")


@pytest.fixture(scope="module")
def submission(checkout, slurm, tmp_path_factory):
    """A folder whose two devices were submitted, the output, and the submissions."""
    folder = tmp_path_factory.mktemp("there")
    write_devices(folder, ["good", "broken"])
    done = run(checkout, folder, "--profile", checkout / slurm, *QUICK, KEPT, target=TARGET)
    listed = ["squeue", "--noheader", "--states=all", f"--format={ASKED}"]
    lines = subprocess.run(listed, capture_output=True, text=True, check=True).stdout.splitlines()
    jobs = [line.split("|") for line in lines]
    return folder, done, [job[:-1] for job in jobs if job[-1] == str(folder)]


def test_a_device_on_slurm_is_one_submission_and_gives_the_same_bytes_as_here(
    submission, local_results
):
    folder, _, jobs = submission
    assert contents(folder / "results/good") == local_results
    assert sorted(state for *_, state in jobs) == ["COMPLETED", "FAILED"]
    # what both sessions' ingest asks for at once with hardly any log
    assert all(cores == "2" and 1900 <= int(memory.rstrip("M")) < 2000 for cores, memory, _ in jobs)


def test_a_failing_job_is_reported_with_a_log_that_says_why(submission):
    folder, done, _ = submission
    assert done.returncode == 1
    log = re.search(r"Error in group device(?:.*\n)*? +log: (\S+)", done.stderr)[1]
    assert "segment broken: an error in the code of imuloop (RuntimeError)" in (
        (folder / log).read_text()
    )


def test_each_job_of_an_array_works_on_its_share(repository, slurm, local_results, tmp_path):
    write_devices(tmp_path, ["good", "broken"])

    def sbatch(*options):
        words = [repository / "profiles/slurm/array.sh", sys.executable, "-m", "snakemake"]
        words += ["-s", repository / "Snakefile", "--configfile", "config.yaml"]
        line = ["sbatch", *options, *words, "--until", "noise"]
        subprocess.run(list(map(str, line)), cwd=tmp_path, check=True, capture_output=True)

    sbatch("--array=1-2", "--mem=1500")
    # as the job that makes the report
    sbatch("--dependency=singleton", "--mem=1500", "--wait")
    assert contents(tmp_path / "results/good") == local_results
    said = [path.read_text() for path in tmp_path.glob("slurm-*.out")]
    assert sorted(text.count("rule noise:") for text in said) == [0, 1, 1]
