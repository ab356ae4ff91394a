"""Snakemake's own report of a finished run: what is marked for it."""

import re

from workflow.run import snakemake


def test_snakemake_makes_its_own_report(finished, checkout):
    folder, _ = finished
    done = snakemake(checkout, folder, "--report", "own.html")
    assert done.returncode == 0, done.stderr
    page = (folder / "own.html").read_text(encoding="utf-8")
    marked = set(re.findall(r'"(results/[^"]+\.(?:html|csv|svg))": \{', page))
    assert {"results/report.html", "results/comparison.csv"} <= marked
    assert {
        "results/posed/figures/poses.svg",
        "results/resting/figures/rest_allan_gyroscope.svg",
    } <= marked
    assert "What it says and the numbers behind it stand in the report." in page
