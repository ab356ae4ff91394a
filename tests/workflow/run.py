"""The workflow run as a user runs it."""

import os
import subprocess
import sys
from pathlib import Path


def command(repository, folder, *arguments, target="results/report.html", config="config.yaml"):
    snakefile = Path(repository) / "Snakefile"
    words = [sys.executable, "-m", "snakemake", "-s", snakefile, "-d", folder, "-c2"]
    words += [*(["--configfile", config] if config else []), *arguments]
    return [str(word) for word in (*words, *(["--", *target.split()] if target else []))]


def snakemake(
    repository,
    folder,
    *arguments,
    target="results/report.html",
    config="config.yaml",
    cwd=None,
    **environment,
):
    """Run the workflow of a repository in a folder; return the finished process."""
    found = {key: value for key, value in os.environ.items() if key != "IMULOOP_MIRROR"}
    return subprocess.run(
        command(repository, folder, *arguments, target=target, config=config),
        cwd=cwd or folder,
        env=found | environment,
        capture_output=True,
        text=True,
    )
