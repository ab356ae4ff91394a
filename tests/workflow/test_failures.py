"""A job that fails stops its device alone, ends the run with an error, and is tried again."""

import os
import re
import shutil
from contextlib import chdir

import pandas as pd
import pytest
import yaml

from imuloop import chain
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json
from imuloop.failures import report_failed_run
from workflow.run import snakemake
from workflow.test_caching import edit, planned_jobs

# lines that a script runs for a device before its stage
BUG = "raise ArithmeticError('forced')"
# for the user, in place of the text of the exception
WHY = "an error in the code of imuloop (ArithmeticError)"


def spoil_stage(checkout, stage, device, code):
    """Have a stage of a device do something else first."""
    path = checkout / f"scripts/{stage}.py"
    before, mark, after = path.read_text().partition("open_log(")
    line, _, after = after.partition("\n")
    hurt = f"if snakemake.wildcards.device == '{device}':\n    {code}\n"
    return edit(path, f"{before}{mark}{line}\n{hurt}{after}")


def stages_of(jobs, device):
    return {job.split("/")[0] for job in jobs if job.split("/")[1] == device}


@pytest.fixture(scope="module")
def failed(finished_run, checkout, tmp_path_factory):
    """A run in a folder in which all was done before, whose diagnosis of `resting` fails.

    Its folder and output, and the jobs that would run next, with the fault and without.
    """
    folder = shutil.copytree(finished_run[0], tmp_path_factory.mktemp("failed") / "work")
    with spoil_stage(checkout, "diagnose", "resting", BUG):
        done = snakemake(checkout, folder)
        again = planned_jobs(checkout, folder)
    return folder, done, again, planned_jobs(checkout, folder)


def test_a_run_with_a_failed_job_ends_with_an_error_and_one_line(failed):
    folder, done, *_ = failed
    text = done.stdout + done.stderr
    assert done.returncode == 1 and "Traceback" not in text
    assert f"diagnose resting failed: {WHY} (more in logs/diagnose/resting.log)" in text
    assert "ArithmeticError: forced" in (folder / "logs/diagnose/resting.log").read_text()


def test_the_report_has_all_other_devices_and_what_failed(failed):
    results = failed[0] / "results"
    table = pd.read_csv(results / "comparison.csv", index_col="device")
    page = (results / "report.html").read_text("utf-8")
    assert dict(table["status"]) == {"resting": "failed", "posed": "ok"}
    assert table["why"]["resting"] == f"diagnose failed: {WHY}"
    assert page.index("Devices in which a stage failed") < page.index('id="rejected"')
    assert 'id="posed"' in page and 'id="resting"' not in page
    links = set(re.findall(r'href="#([^"]+)"', page))
    assert links <= set(re.findall(r'id="([^"]+)"', page))


def test_the_next_run_tries_again(failed):
    _, _, again, mended = failed
    for jobs in (again, mended):
        assert stages_of(jobs, "resting") == {"diagnose", "allan", "report_device"}
        assert "report/report" in jobs
    assert stages_of(again, "posed") == set()


def test_a_part_that_is_older_than_a_result_is_not_shown(failed):
    """As after a run that ended at the first failure, before a changed device was reported."""
    folder, *_ = failed
    config = yaml.safe_load((folder / "config.yaml").read_text())
    page, noise = (folder / "results/posed" / name for name in ("section.html", "noise.json"))
    page.write_text("an earlier part")
    os.utime(noise, (page.stat().st_mtime + 5,) * 2)
    with chdir(folder):
        report_failed_run(config)
        assert not page.exists()
        # without a part, and nothing in its log: as after a job that was killed
        lines = report_failed_run(config)
    assert [line for line in lines if line.startswith("report_device posed failed: no message")]
    report = (folder / "results/report.html").read_text("utf-8")
    # of several failed devices only their names are left
    assert "<strong>report_device</strong>" in report and 'id="posed"' not in report
    assert 'id="comparison"' not in report


def test_a_log_that_lacks_a_declared_column_is_rejected(tmp_path):
    """A result in the workflow, an error in Python."""
    (tmp_path / "a.csv").write_text("t,ax,ay,az,gx,gy,gz\n" + "0,0,0,9.8,0,0,0\n" * 50)
    device = chain.Device("imu", tmp_path / "imu", {"a": "static"})
    session = device, "a", {"columns": {"temperature": "T"}}, [tmp_path / "a.csv"]
    with pytest.raises(ImuloopError, match=r"columns.temperature"):
        chain.ingest(*session)
    chain.ingest(*session, reject=True)
    quality = read_json(tmp_path / "imu/a/quality.json")
    assert quality["status"] == "rejected" and "columns.temperature" in quality["reasons"][0]
    # what follows takes it as any other rejected session
    chain.segment(device)
    chain.noise(device)
    assert read_json(device.file("noise.json"))["axes"]["ax"]["N"]["upper95"] is None
