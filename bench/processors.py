"""The measured devices by the code that each kind of processor runs: the same verdicts and figures.

From the repository, its library on the path: ``python -m bench.processors``. OpenBLAS and NumPy
choose their code by the processor; each kind that this machine can run makes the results of the
devices. The numeric tests run by the oldest; ``make test`` runs them by the newest. Ends with 1
where a test fails, a word differs at all, or a number by more than `BOUND` of its size.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from bench.measured import devices, ingested, missing
from bench.study.chain import through
from bench.tables import REPOSITORY

# what computes, the published figures and the report apart, and without the long simulations
TESTS = [f"tests/{name}" for name in ("core", "segment", "noise", "calibrate", "diagnose")]
TESTS += ["-k", "not test_study and not test_gaps and not test_bench"]
# kinds by OpenBLAS's name, the newest first, and what such a processor has by NumPy's
KINDS = {"SkylakeX": "X86_V4", "Haswell": "X86_V3", "Nehalem": "X86_V2"}
# stands for a processor without anything that NumPy chooses
OLD = "Nehalem"
# largest difference, share of the size
BOUND = 1e-5


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2, help="of the tests")
    # of the processes that this one starts, one by the code of each kind
    parser.add_argument("--make", type=Path, metavar="FOLDER", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.make:
        return make(options.make)
    simd = np.show_config(mode="dicts")["SIMD Extensions"]
    kinds = [kind for kind, has in KINDS.items() if has in simd["baseline"] + simd["found"]]
    print(f"kinds of processor: {', '.join(kinds)} of {', '.join(KINDS)}", flush=True)
    failed = False
    if OLD in kinds:
        tests = "pytest", "-q", "-n", options.workers, "-p", "no:cacheprovider", *TESTS
        failed = bool(start(OLD, *tests).wait())
    # fetched once, before several processes read them
    reasons = {name: missing(name) for name in devices()}
    print(*(f"{name} left out: {reason}" for name, reason in reasons.items() if reason), sep="\n")
    with tempfile.TemporaryDirectory() as folder:
        making = [start(k, "bench.processors", "--make", Path(folder, k)) for k in kinds]
        failed |= any([process.wait() for process in making])
        faults = [f for kind in kinds[1:] for f in compared(Path(folder), kinds[0], kind)]
    print(*faults, sep="\n")
    return bool(faults) or failed


def start(kind, *command):
    """Start a Python module in a process of its own, by the code of a kind of processor."""
    environment = os.environ | {"OPENBLAS_CORETYPE": kind, "OPENBLAS_NUM_THREADS": "1"}
    if kind == OLD:
        chosen = np.show_config(mode="dicts")["SIMD Extensions"]["found"]
        environment["NPY_DISABLE_CPU_FEATURES"] = " ".join(chosen)
    command = [sys.executable, "-m", *map(str, command)]
    return subprocess.Popen(command, env=environment, cwd=REPOSITORY)


def make(folder):
    """Make the results of the devices whose recordings are at hand, in this process."""
    for name in devices():
        if not missing(name):
            through(ingested(name, folder / name))


def compared(folder, first, other):
    """Return a line for each figure in which the results of two kinds differ; say the largest."""
    shares, faults = [0.0], []
    for path in sorted(Path(folder, first).rglob("*.json")):
        name = path.relative_to(folder / first)
        contents = (json.loads(Path(folder, kind, name).read_text()) for kind in (first, other))
        for place, values, share in differences(*contents):
            shares.append(share)
            if share > BOUND:
                faults.append(f"{other} beside {first}: {name} {place}: {values[1]}, {values[0]}")
    print(f"{other} beside {first}: {len(shares) - 1} values, largest difference {max(shares):.2g}")
    return faults


def differences(one, other, place="", size=0.0):
    """Yield place, both values and their difference, share of their size, of all in two contents.

    The size of a number in a list, the end of an interval or a part of a vector, is that of the
    largest there; that of an estimate is at least its standard error. What is no number differs
    infinitely or not at all.
    """
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        sizes = size if isinstance(size, dict) else {"parameters": one.get("std")}
        for key in one:
            yield from differences(one[key], other[key], f"{place}/{key}", sizes.get(key) or 0.0)
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        size = max((abs(x) for x in (*one, *other) if is_number(x)), default=0.0)
        for i, values in enumerate(zip(one, other, strict=True)):
            yield from differences(*values, f"{place}/{i}", size)
    elif is_number(one) and is_number(other):
        size = max(abs(one), abs(other), size)
        yield place, (one, other), abs(one - other) / size if size else 0.0
    else:
        yield place, (one, other), 0.0 if one == other else math.inf


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)


if __name__ == "__main__":
    sys.exit(main())
