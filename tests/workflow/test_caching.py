"""Jobs that run again after a change, and no others: dry runs in a folder where all was done."""

import os
import re
import shutil
import signal
import subprocess
import time
from contextlib import contextmanager

import pytest
import yaml

from imuloop.core.files import read_json
from imuloop.core.samples import SENSORS
from workflow.conftest import CONFIG
from workflow.run import command, snakemake

# the stages of a device that follow ingest, in their order
STAGES = ("segment", "noise", "calibrate", "diagnose", "allan", "report_device")
SESSIONS = {name: tuple(device["sessions"]) for name, device in CONFIG["devices"].items()}
SESSIONS["new"] = ("rest",)
REPORT = {"report/report"}


def jobs(device, first, *read):
    """Return the jobs of a device from a stage on, and those that read some sessions before."""
    names_of_jobs = {f"{stage}/{device}/{name}" for stage in ("ingest", "segment") for name in read}
    for stage in STAGES[STAGES.index(first) :]:
        names = SESSIONS[device] if stage == "allan" else ()
        names_of_jobs |= {f"{stage}/{device}/{name}" for name in names} or {f"{stage}/{device}"}
    return names_of_jobs


def planned_jobs(checkout, folder, changed=None, **options):
    """Return the jobs that would run now, each by its log: stage/device or stage/device/session."""
    if changed:
        (folder / "config.yaml").write_text(yaml.safe_dump(changed, sort_keys=False))
    done = snakemake(checkout, folder, "-n", **options)
    assert done.returncode == 0, done.stderr
    return set(re.findall(r"^ +log: logs/(\S+)\.log$", done.stdout + done.stderr, re.M))


@pytest.fixture
def folder(finished_run, tmp_path):
    """A copy of the folder in which all was done, with its times."""
    return shutil.copytree(finished_run[0], tmp_path / "work")


@pytest.fixture
def written_config(finished_run):
    return yaml.safe_load((finished_run[0] / "config.yaml").read_text())


@contextmanager
def edit(path, source):
    """Have another source in a file of the checkout, which all tests share."""
    before = path.read_text()
    path.write_text(source)
    yield
    path.write_text(before)


def test_what_changes_no_content_reruns_nothing(finished_run, checkout, written_config, tmp_path):
    """New times of all files, a comment, a docstring, a device less, another order of keys."""
    # as a cache restores it: other times, no logs, and of Snakemake's folder only its records
    ignored = shutil.ignore_patterns("logs", "benchmarks", ".snakemake")
    folder = shutil.copytree(finished_run[0], tmp_path / "work", ignore=ignored)
    shutil.copytree(finished_run[0] / ".snakemake/metadata", folder / ".snakemake/metadata")
    # first the last result, then its inputs
    for path in sorted((*checkout.rglob("*"), *folder.rglob("*")), reverse=True):
        path.touch()
    module = checkout / "workflow/lib/imuloop/diagnose/content.py"
    source = module.read_text().replace('"""', '"""Again: ', 1)
    with edit(module, f"# another comment\n{source}"):
        assert planned_jobs(checkout, folder) == set()
        # a label concerns the pages; only results of several devices name them
        device = written_config["devices"]["resting"] | {"label": "Other"}
        turned = {"resting": dict(reversed(device.items()))}
        expected = jobs("resting", "report_device") | REPORT
        assert planned_jobs(checkout, folder, {**written_config, "devices": turned}) == expected


def test_a_key_and_a_log_rerun_what_depends_on_them_and_a_new_device_is_an_entry(
    folder, checkout, written_config
):
    """The log, a file in a folder, is as large as the one before and older, as a copy may be."""
    devices = written_config["devices"]
    devices["posed"]["noise"] = {"points_per_decade": 5}
    devices["new"] = {"sessions": {"rest": {"kind": "static", "file": "rest.parquet"}}}
    log = folder / "faces/data.csv"
    text = log.read_text().rstrip("\n")
    log.write_text(f"{text[:-1]}{(int(text[-1]) + 1) % 10}\n")
    os.utime(log, (0, 0))
    expected = jobs("posed", "noise") | jobs("resting", "noise", "faces")
    expected |= jobs("new", "noise", "rest") | REPORT
    assert planned_jobs(checkout, folder, written_config) == expected


def test_gravity_reruns_the_calibration_of_its_device(folder, checkout, written_config):
    written_config["devices"]["posed"]["gravity"] = 9.81
    expected = jobs("posed", "calibrate") | REPORT
    assert planned_jobs(checkout, folder, written_config) == expected


def test_a_prior_and_a_tolerance_rerun_the_calibration_of_their_device(
    folder, checkout, written_config
):
    """The file of the prior is as large as the one before and older."""
    calibration = read_json(folder / "results/resting/calibration.json")
    assert {calibration[sensor]["prior"]["source"] for sensor in SENSORS} == {"earlier.json"}
    earlier = folder / "earlier.json"
    text = earlier.read_text()
    earlier.write_text(text.replace('"gravity": 9.80665', '"gravity": 9.80655'))
    assert earlier.read_text() != text
    os.utime(earlier, (0, 0))
    written_config["devices"]["posed"]["nominal"] = {"angular_rate": {"tolerance": {"bias": 0.1}}}
    expected = jobs("resting", "calibrate") | jobs("posed", "calibrate") | REPORT
    assert planned_jobs(checkout, folder, written_config) == expected


def test_a_default_reruns_the_devices_that_do_not_override_it(folder, checkout, written_config):
    """The range of a sensor, with its full scale, is of reading the logs."""
    ranged = {"sensor": "icm42688p", "range": {"acceleration": "16 g"}}
    written_config["devices"]["posed"] |= {"diagnose": {"folds": 3}, **ranged}
    written_config["defaults"]["diagnose"]["folds"] = 4
    # the order of the devices changes no device
    written_config["devices"] = dict(reversed(written_config["devices"].items()))
    expected = jobs("posed", "noise", *SESSIONS["posed"]) | jobs("resting", "diagnose") | REPORT
    assert planned_jobs(checkout, folder, written_config) == expected


def test_an_edited_module_reruns_the_stages_that_import_it(finished_run, checkout):
    module = checkout / "workflow/lib/imuloop/diagnose/content.py"
    with edit(module, f"{module.read_text()}\nEXTRA = 1\n"):
        planned = planned_jobs(checkout, finished_run[0])
    assert (
        planned
        == {job for device in CONFIG["devices"] for job in jobs(device, "diagnose")} | REPORT
    )


@pytest.mark.parametrize(("reader", "reruns"), [("ros", False), ("delimited", True)])
def test_an_edited_reader_reruns_ingest_of_its_formats(finished_run, checkout, reader, reruns):
    module = checkout / f"workflow/lib/imuloop/ingest/{reader}.py"
    with edit(module, f"{module.read_text()}\nEXTRA = 1\n"):
        planned = planned_jobs(checkout, finished_run[0])
    ingest = {f"ingest/{device}/{name}" for device, names in SESSIONS.items() for name in names}
    assert planned & ingest == (ingest - {"ingest/new/rest"} if reruns else set())


def test_an_edited_template_reruns_its_jobs(finished_run, checkout):
    file = checkout / "workflow/templates/export/left_out.j2"
    with edit(file, f"{file.read_text()}\nX = 1\n"):
        planned = planned_jobs(checkout, finished_run[0])
    assert planned == {f"report_device/{device}" for device in CONFIG["devices"]} | REPORT


# message about a result that was cut
CUT = "results/posed/poses/quality.json: no JSON"


@pytest.fixture(scope="module")
def killed_run(finished_run, checkout, tmp_path_factory):
    """A folder whose run was killed during a job, and its message about a result cut before."""
    folder = shutil.copytree(finished_run[0], tmp_path_factory.mktemp("killed") / "work")
    path = folder / "results/posed/poses/quality.json"
    path.write_bytes(path.read_bytes()[:-100])
    script, log = checkout / "scripts/report_device.py", folder / "printed"
    asleep = f"{script.read_text()}\nif device.name == 'resting':\n    import time\n\n"
    asleep += "    open(device.name, 'w')\n    time.sleep(60)\n"
    targets = "results/resting/exports results/posed/exports"
    with edit(script, asleep), open(log, "w") as printed:
        run = subprocess.Popen(
            command(checkout, folder, "-k", target=targets),
            cwd=folder,
            start_new_session=True,
            stdout=printed,
            stderr=subprocess.STDOUT,
        )
        while run.poll() is None and not ((folder / "resting").exists() and CUT in log.read_text()):
            time.sleep(0.05)
        os.killpg(run.pid, signal.SIGKILL)
        assert run.wait() == -signal.SIGKILL
    return folder, log.read_text()


def test_a_result_that_was_cut_is_named(killed_run):
    _, printed = killed_run
    assert CUT in printed and "Traceback" not in printed


def test_a_job_that_was_killed_runs_again(killed_run, checkout):
    """Its results are there, but may not be whole."""
    folder, _ = killed_run
    assert (folder / "results/resting/exports/README.txt").exists()
    assert "report_device/resting" in planned_jobs(checkout, folder)
