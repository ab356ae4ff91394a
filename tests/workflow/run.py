"""The workflow run as a user runs it."""

import os
import subprocess
import sys


def snakemake(
    repository,
    folder,
    *arguments,
    target="results/report.html",
    config="config.yaml",
    **environment,
):
    """Run the workflow of a repository in a folder; return the finished process."""
    command = [sys.executable, "-m", "snakemake", "-s", repository / "Snakefile", "-d", folder]
    named = ["--configfile", config] if config else []
    command += ["-c2", *named, *arguments, "--", target]
    found = {key: value for key, value in os.environ.items() if key != "IMULOOP_MIRROR"}
    return subprocess.run(
        list(map(str, command)), cwd=folder, env=found | environment, capture_output=True, text=True
    )
