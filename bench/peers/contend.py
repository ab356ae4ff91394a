"""A contender in a process of its own, in this environment or in that of the peers."""

import json
import os
import subprocess
import sys
from pathlib import Path

from bench.peers.calls import CURVES, FACES_CALLS

REPOSITORY = Path(__file__).resolve().parents[2]
# freed memory stays with the process: else page faults of temporaries count, or not, by chance
ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONPATH": os.pathsep.join([str(REPOSITORY / "workflow/lib"), str(REPOSITORY)]),
    "MALLOC_MMAP_THRESHOLD_": str(1 << 25),
    "MALLOC_TRIM_THRESHOLD_": str(1 << 32),
}


def contend(name, folder, environment):
    """Run one of `bench.peers.calls` on a folder's data; return what it printed, or why it failed.

    `environment` is the virtual one of the peers, with the log of what did not install.
    """
    _, distribution = (CURVES | FACES_CALLS)[name]
    python = environment / "bin/python" if distribution else sys.executable
    if distribution and not python.exists():
        return "there is no environment of the peers"
    command = [str(python), "-m", "bench.peers.calls", name, str(folder)]
    done = subprocess.run(
        command, env={**os.environ, **ENVIRONMENT}, capture_output=True, text=True
    )
    if not done.returncode:
        return json.loads(done.stdout.splitlines()[-1])
    reason = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
    log = environment / f"{distribution}.log"
    if reason.startswith("ModuleNotFoundError") and log.exists():
        errors = [line for line in log.read_text().splitlines() if line.startswith("ERROR")]
        reason = errors[-1] if errors else reason
    return reason
