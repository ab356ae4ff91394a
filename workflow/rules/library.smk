"""The library in the path of every script, on a cluster too, before one that is installed."""

import os
import sys
from pathlib import Path


def end_with(faults):
    """End the run with faults of the config, a line each, if there are any.

    Around an exception Snakemake would print where it was raised.
    """
    if faults:
        print(*faults, sep="\n", file=sys.stderr)
        sys.exit(1)


library = str(Path(workflow.current_basedir).with_name("lib"))
sys.path.insert(0, library)
# for jobs in a Conda environment, which has no imuloop, and for the library of another clone
others = os.environ.get("PYTHONPATH")
os.environ |= {"PYTHONPATH": os.pathsep.join(filter(None, [library, others]))}
