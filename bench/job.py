"""Processor time of one job of the workflow: its own script, as Snakemake would run it.

``python -m bench.job SCRIPT JOB.json``: the file holds what Snakemake would give, `input`,
`output`, `params` and so on. Printed is, in s, what the whole process took up to the end of a first
run, imports and the start of Python included, and the least of some further runs in it: the work;
and the memory at the peak, bytes.
"""

import json
import runpy
import sys
import time
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

from bench.memory import peak_memory

script, path, *repeats = sys.argv[1:]
with open(path) as file:
    content = json.load(file)
job = SimpleNamespace(
    scriptdir=str(Path(script).resolve().parent),
    **{key: SimpleNamespace(**v) if isinstance(v, dict) else v for key, v in content.items()},
)


def run():
    """Run the script once."""
    runpy.run_path(script, init_globals={"snakemake": job})
    return time.process_time()


taken = [run()]
for _ in range(int(repeats[0]) if repeats else 1):
    taken.append(run())
work = min(after - before for before, after in pairwise(taken))
told = {"process": taken[0], "work": work, "memory": peak_memory()}
print(json.dumps(told), file=sys.__stdout__)
