"""A contender in a process of its own, in this environment or in that of the peers."""

import json
import os
import subprocess
import sys
from pathlib import Path

from bench.stages import ONE_THREAD

# freed memory stays with the process: else page faults of temporaries count, or not, by chance
ENVIRONMENT = {
    **ONE_THREAD,
    "MALLOC_MMAP_THRESHOLD_": str(1 << 25),
    "MALLOC_TRIM_THRESHOLD_": str(1 << 32),
}


def contend(module, name, folder, environment=None):
    """Run ``bench.peers.<module> NAME FOLDER``; return what it printed, or why it failed.

    Parameters
    ----------
    module, name : str
        Module of this package and the contender in it.
    folder : path-like
        With the data.
    environment : Path or None
        Virtual environment of the peers, with the log of what did not install; None for this one.

    Returns
    -------
    dict or str
    """
    python = environment / "bin/python" if environment else sys.executable
    if not Path(python).exists():
        return "there is no environment of the peers"
    command = [python, "-m", f"bench.peers.{module}", name, folder]
    done = subprocess.run(
        [str(each) for each in command],
        env={**os.environ, **ENVIRONMENT},
        capture_output=True,
        text=True,
    )
    if not done.returncode:
        return json.loads(done.stdout.splitlines()[-1])
    reason = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
    if environment and reason.startswith("ModuleNotFoundError"):
        told = [
            line
            for log in environment.glob("*.log")
            for line in log.read_text().splitlines()
            if line.startswith("ERROR") and log.stem in name
        ]
        reason = told[-1] if told else reason
    return reason
