"""What is done again after a change, and what is not: dry runs in a folder where all was done."""

import os
import re
import shutil
import signal
import subprocess
import time
from contextlib import contextmanager

import pytest
import yaml

from workflow.run import command, snakemake

# the stages of a device that follow its sessions, in their order
STAGES = ("segment", "noise", "calibrate", "diagnose", "export", "report_device")


def jobs(device, first, *sessions):
    """Return the jobs of a device from a stage on, those of some sessions before them."""
    before = {f"ingest/{device}/{name}" for name in sessions}
    return before | {f"{stage}/{device}" for stage in STAGES[STAGES.index(first) :]}


REPORT = {"report/report"}


def planned(checkout, folder, devices=None, **options):
    """Return the jobs that would run now, each by its log: stage/device or stage/device/session."""
    if devices:
        (folder / "config.yaml").write_text(yaml.safe_dump(devices, sort_keys=False))
    done = snakemake(checkout, folder, "-n", **options)
    assert done.returncode == 0, done.stderr
    return set(re.findall(r"^ +log: logs/(\S+)\.log$", done.stdout + done.stderr, re.M))


@pytest.fixture
def folder(finished, tmp_path):
    """A copy of the folder in which all was done, with its times."""
    return shutil.copytree(finished[0], tmp_path / "work")


@pytest.fixture
def written(finished):
    """The config as it is written there; the order of a device's sessions counts."""
    return yaml.safe_load((finished[0] / "config.yaml").read_text())


@pytest.fixture
def with_keys(written):
    """Return a function: the config with some keys of a device changed, or with a new device."""

    def changed(device, **keys):
        devices = written["devices"]
        return {**written, "devices": {**devices, device: {**devices.get(device, {}), **keys}}}

    return changed


@contextmanager
def edited(path, source):
    """Have another source in a file of the checkout, which all tests share."""
    before = path.read_text()
    path.write_text(source)
    yield
    path.write_text(before)


def test_a_second_run_has_nothing_to_do(finished, checkout):
    folder, _ = finished
    before = (folder / "results/report.html").read_bytes()
    done = snakemake(checkout, folder)
    assert "Nothing to be done" in done.stdout + done.stderr
    assert (folder / "results/report.html").read_bytes() == before


def test_what_changes_no_content_reruns_nothing(finished, checkout, written, tmp_path):
    """New times of all files, a comment, a docstring, the order of the config."""
    # as a cache restores it: other times, no logs, and of Snakemake's folder only its records
    left = shutil.ignore_patterns("logs", "benchmarks", ".snakemake")
    folder = shutil.copytree(finished[0], tmp_path / "work", ignore=left)
    shutil.copytree(finished[0] / ".snakemake/metadata", folder / ".snakemake/metadata")
    # first the last result, then what it was made from
    for path in sorted((*checkout.rglob("*"), *folder.rglob("*")), reverse=True):
        path.touch()
    turned = {**written, "devices": dict(reversed(written["devices"].items()))}
    module = checkout / "workflow/lib/imuloop/diagnose/verdict.py"
    source = module.read_text().replace('"""', '"""Again: ', 1)
    with edited(module, f"# another comment\n{source}"):
        assert planned(checkout, folder) == set()
        # only the report names the devices in the order of the config
        assert planned(checkout, folder, turned) == REPORT


@pytest.mark.parametrize(
    ("device", "keys", "first", "read"),
    [
        ("posed", {"label": "Other"}, "export", ()),
        # the yardstick of each session's units, too
        ("posed", {"gravity": 9.81}, "segment", ("poses", "faces", "broken")),
        ("resting", {"noise": {"points_per_decade": 5}}, "noise", ()),
    ],
    ids=["label", "gravity", "noise"],
)
def test_a_key_reruns_what_depends_on_it(folder, checkout, with_keys, device, keys, first, read):
    found = planned(checkout, folder, with_keys(device, **keys))
    assert found == jobs(device, first, *read) | REPORT


def test_a_default_reruns_the_devices_that_do_not_override_it(folder, checkout, with_keys):
    config = with_keys("posed", diagnose={"folds": 3})
    config["defaults"] = {"diagnose": {**config["defaults"]["diagnose"], "folds": 4}}
    assert planned(checkout, folder, config) == jobs("resting", "diagnose") | REPORT


def test_a_new_device_is_an_entry_and_nothing_else(folder, checkout, with_keys):
    new = with_keys("new", sessions={"rest": {"kind": "static", "file": "rest.parquet"}})
    assert planned(checkout, folder, new) == jobs("new", "segment", "rest") | REPORT


def test_a_device_that_is_gone_reruns_the_report_alone(folder, checkout, written):
    del written["devices"]["resting"]
    assert planned(checkout, folder, written) == REPORT


def test_a_changed_log_reruns_what_comes_from_it(folder, checkout):
    log = folder / "faces.csv"
    lines = log.read_text().splitlines(keepends=True)
    log.write_text("".join(lines[:-1]))
    assert planned(checkout, folder) == jobs("posed", "segment", "faces") | REPORT


def test_a_log_that_an_older_file_replaced_is_read_again(folder, checkout):
    """Of the same size, with an older time, it cannot be told without reading all of it."""
    log = folder / "faces.csv"
    lines = log.read_text().splitlines(keepends=True)
    log.write_text("".join(lines[:-1]))
    os.utime(log, (0, 0))
    assert planned(checkout, folder) == jobs("posed", "segment", "faces") | REPORT


@pytest.mark.parametrize("name", ["rest/quality.json", "rest/samples.parquet"])
def test_a_result_that_was_cut_is_named(folder, checkout, name):
    path = folder / "results/resting" / name
    path.write_bytes(path.read_bytes()[:-100])
    done = snakemake(checkout, folder)
    told = done.stdout + done.stderr
    assert re.search(rf"results/resting/{name}: no (JSON|whole Parquet file)", told)
    assert "Traceback" not in told
    shutil.rmtree(folder / "results/resting")
    (folder / "results/report.html").unlink()
    done = snakemake(checkout, folder)
    assert done.returncode == 0 and f"{name}: no" not in done.stdout + done.stderr
    assert '"failed": []' in (folder / "results/resting/summary.json").read_text()


def test_an_edited_module_reruns_the_stages_that_reach_it(folder, checkout):
    module = checkout / "workflow/lib/imuloop/diagnose/verdict.py"
    with edited(module, f"{module.read_text()}\nEXTRA = 1\n"):
        found = planned(checkout, folder)
    assert found == jobs("posed", "diagnose") | jobs("resting", "diagnose") | REPORT


def test_an_edited_script_reruns_its_jobs_and_what_follows(folder, checkout):
    """Also where its results stay the same: what follows is fixed before the first job."""
    script = checkout / "scripts/calibrate.py"
    with edited(script, f"{script.read_text()}\nEXTRA = 1\n"):
        found = planned(checkout, folder)
    assert found == jobs("posed", "calibrate") | jobs("resting", "calibrate") | REPORT


@pytest.mark.parametrize(
    ("name", "rerun"),
    [
        ("section.html.j2", {"report_device/posed", "report_device/resting"}),
        ("style.css", {"report_device/posed", "report_device/resting"}),
        ("report.html.j2", set()),
    ],
)
def test_an_edited_template_reruns_the_pages_made_with_it(folder, checkout, name, rerun):
    template = checkout / "workflow/templates" / name
    with edited(template, f"{template.read_text()}\n"):
        assert planned(checkout, folder) == rerun | REPORT


def test_a_deleted_result_is_made_again_where_it_is_asked_for(folder, checkout):
    """What nothing needs any more is not missed: the report is there, and newer."""
    (folder / "results/resting/calibration.json").unlink()
    (folder / "results/report.html").unlink()
    assert planned(checkout, folder) == REPORT
    found = planned(checkout, folder, target="results/resting/calibration.json")
    assert found == {"diagnose/resting"}


def test_a_job_that_was_killed_runs_again(folder, checkout):
    """Its results are there, and nobody knows whether they are whole."""
    script = checkout / "scripts/export.py"
    asleep = f"{script.read_text()}\nimport time\nopen('here', 'w')\ntime.sleep(60)\n"
    with edited(script, asleep):
        target = "results/resting/exports"
        run = subprocess.Popen(
            command(checkout, folder, target=target),
            cwd=folder,
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        while run.poll() is None and not (folder / "here").exists():
            time.sleep(0.05)
        os.killpg(run.pid, signal.SIGKILL)
        assert run.wait() == -signal.SIGKILL
    assert (folder / target / "README.txt").exists()
    assert planned(checkout, folder) >= {"export/resting"}


def test_any_working_folder_and_no_target(finished, checkout, tmp_path):
    """The library is found from anywhere, and `rule all` is what is made without a target."""
    folder, _ = finished
    elsewhere = tmp_path / "else where"
    shutil.copytree(folder / "logs in", elsewhere / "logs in")
    for name in ("faces.csv", "broken.csv", "rest.parquet", "config.yaml"):
        shutil.copy(folder / name, elsewhere / name)
    found = planned(
        os.path.relpath(checkout, tmp_path),
        elsewhere,
        target=None,
        config="else where/config.yaml",
        cwd=tmp_path,
    )
    assert found == (
        jobs("posed", "segment", "poses", "faces", "broken")
        | jobs("resting", "segment", "rest")
        | REPORT
    )


def test_a_log_that_is_a_folder_counts_by_its_files(checkout, tmp_path):
    log, target = tmp_path / "rec", "results/a/rest/samples.parquet"
    log.mkdir()
    rows = [f"{i * 10**7},0.01,0.02,{i % 7 / 1e3},0.1,0.2,9.8{i % 10}" for i in range(500)]
    head = "#timestamp [ns],w_RS_S_x,w_RS_S_y,w_RS_S_z,a_RS_S_x,a_RS_S_y,a_RS_S_z"
    (log / "data.csv").write_text("\n".join([head, *rows]))
    device = {"sessions": {"rest": {"kind": "static", "format": "euroc", "file": "rec"}}}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({"devices": {"a": device}}))
    done = snakemake(checkout, tmp_path, target=target)
    assert done.returncode == 0, done.stderr
    for path in (log / "data.csv", log):
        path.touch()
    assert planned(checkout, tmp_path, target=target) == set()
    (log / "data.csv").write_text("\n".join([head, *rows[1:]]))
    assert planned(checkout, tmp_path, target=target) == {"ingest/a/rest"}
