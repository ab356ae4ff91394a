"""A good device beside faulty logs and a failing stage, through the workflow: it stays the same."""

import csv
import json

from workflow.conftest import FAULTY


def test_the_files_of_a_good_device_are_the_same_bytes(finished, beside):
    for _, done in (finished, beside):
        assert done.returncode == 0, done.stderr
    alone, other = (folder / "results/resting" for folder, _ in (finished, beside))
    files = [path.relative_to(alone) for path in alone.rglob("*") if path.is_file()]
    assert len(files) > 20
    assert [p for p in files if (alone / p).read_bytes() != (other / p).read_bytes()] == []


def test_each_fault_of_a_log_is_reported_without_a_traceback(beside):
    folder, done = beside
    section = (folder / "results/faulty/section.html").read_text()
    for name, (_, _, status, text) in FAULTY.items():
        quality = json.loads((folder / f"results/faulty/{name}/quality.json").read_text())
        assert quality["status"] == status, name
        said = quality["reasons"] if status == "rejected" else quality["warnings"]
        assert any(text in line for line in said), (name, said)
        rejected = "rejected: " if status == "rejected" else ""
        lines = [line for line in done.stderr.splitlines() if f"faulty/{name}: {rejected}" in line]
        assert any(" ".join(text.split()) in line for line in lines), (name, lines)
        assert name in section
    assert "Traceback" not in done.stdout + done.stderr
    with_traceback = [p for p in (folder / "logs").rglob("*.log") if "Traceback" in p.read_text()]
    assert with_traceback == [folder / "logs/noise/failing.log"]


def test_a_stage_that_failed_is_named_on_the_terminal_and_first_in_the_report(beside):
    folder, done = beside
    line = "failing: noise failed: forced; the traceback is in logs/noise/failing.log\n"
    assert line in done.stderr
    page = (folder / "results/report.html").read_text()
    assert page.index("Devices in which a stage failed") < page.index('id="rejected"')
    assert "logs/noise/failing.log" in page
    with open(folder / "results/comparison.csv", encoding="utf-8") as file:
        rows = {row["device"]: row for row in csv.DictReader(file)}
    assert {name: row["status"] for name, row in rows.items()} == {
        "faulty": "ok",
        "failing": "failed",
        "resting": "ok",
    }
    assert "noise failed: forced" in rows["failing"]["why"] and not rows["resting"]["why"]
