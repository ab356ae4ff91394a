"""Memory of a process at its peak."""

import resource
import sys
from pathlib import Path


def peak_memory():
    """Return the bytes of memory that this process had at most."""
    # where there is /proc: what getrusage tells may be the parent's, from before the program began
    if (status := Path("/proc/self/status")).exists():
        lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return 1024 * int(lines["VmHWM"].split()[0])
    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
