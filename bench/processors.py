"""The measured devices by the code that each kind of processor runs: the same verdicts and figures.

From the repository, its library on the path: ``python -m bench.processors``. OpenBLAS and NumPy
choose their code by the processor; each kind that this machine can run is taken in turn, and one
that it cannot is skipped with the reason. The numeric tests run with each but the kind in use, by
which ``make test`` runs them. Ends with 1 where a test fails, a word differs at all, or a number by
more than `BOUND` of its size.
"""

import argparse
import ctypes
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import yaml
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
from numpy.linalg import _umath_linalg

from imuloop import chain
from imuloop.chain import Device
from imuloop.config import STAGES, fetched, resolve, source_path
from imuloop.core.errors import ImuloopError
from imuloop.ingest.sources import fetch

REPOSITORY = Path(__file__).resolve().parents[1]
CACHE = REPOSITORY / "data/cache"
CONFIGS = "config/measured.yaml", "config.yaml"
# what computes, the published figures and the report apart, and without the long simulations
TESTS = [f"tests/{name}" for name in ("core", "segment", "noise", "calibrate", "diagnose")]
TESTS += ["-k", "not test_study and not test_gaps and not test_bench"]
# kinds by OpenBLAS's name, and what such a processor has by NumPy's
KINDS = {"Haswell": ("AVX2", "FMA3"), "SkylakeX": ("AVX512_SKX",), "Nehalem": ("SSE42",)}
# stands for a processor without anything that NumPy chooses
OLD = "Nehalem"
# largest difference, share of the size
BOUND = 1e-5


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--skip-tests", action="store_true", help="the devices alone")
    # of the processes that this one starts
    parser.add_argument("--make", nargs=2, metavar=("DEVICE", "FOLDER"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.make:
        name, folder = options.make
        make(name, devices()[name], Path(folder))
        return
    start, kinds = time.monotonic(), here()
    if len(kinds) < 2:
        print("nothing to compare")
        return
    passed = options.skip_tests or all([tested(kind, options.workers) for kind in kinds])
    names = [name for name, device in devices().items() if at_hand(name, device)]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.workers) as pool:
        every = [(kind, name, Path(folder, kind, name)) for kind in kinds for name in names]
        list(pool.map(lambda each: made_by(*each), every))
        first, *others = kinds
        faults = [f for kind in others for f in compared(Path(folder), first, kind)]
    for fault in faults:
        print(fault)
    print(f"{', '.join(kinds)}: {len(names)} devices in {time.monotonic() - start:.0f} s")
    sys.exit(bool(faults) or not passed)


def here():
    """Return the kinds that this machine can run; of the others it says why not."""
    kinds = []
    for kind, needed in KINDS.items():
        lacking = [feature for feature in needed if not __cpu_features__.get(feature)]
        if lacking:
            print(f"{kind} skipped: this machine has no {', '.join(lacking)}")
        else:
            kinds.append(kind)
    return kinds


def in_use():
    """Return the kind that OpenBLAS has chosen in this process."""
    name = ctypes.CDLL(_umath_linalg.__file__).scipy_openblas_get_corename64_
    name.restype = ctypes.c_char_p
    return name().decode()


def run(kind, *command, **how):
    """Run a Python module in a process of its own, by the code of a kind of processor."""
    environment = os.environ | {"OPENBLAS_CORETYPE": kind, "OPENBLAS_NUM_THREADS": "1"}
    if kind == OLD:
        chosen = [feature for feature in __cpu_dispatch__ if __cpu_features__.get(feature)]
        environment["NPY_DISABLE_CPU_FEATURES"] = " ".join(chosen)
    command = [sys.executable, "-m", *map(str, command)]
    return subprocess.run(command, env=environment, cwd=REPOSITORY, check=False, **how)


def tested(kind, workers):
    """Return whether the numeric tests pass; those of the kind in use are run by ``make test``."""
    if kind == in_use():
        return True
    print(f"numeric tests as on {kind}", flush=True)
    options = "-q", "-n", workers, "--dist", "loadgroup", "-p", "no:cacheprovider"
    return run(kind, "pytest", *options, *TESTS).returncode == 0


def devices():
    """Return the resolved config of the devices that were measured."""
    found = {}
    for path in CONFIGS:
        found |= resolve(yaml.safe_load((REPOSITORY / path).read_text()))
    return {name: device for name, device in found.items() if fetched({name: device})}


def at_hand(name, device):
    """Return whether the recordings of a device are in the cache, or could be brought there."""
    try:
        for place, source in fetched({name: device}).items():
            if not (CACHE / place).exists():
                fetch(source, CACHE / place, mirror=os.environ.get("IMULOOP_MIRROR"))
    except ImuloopError as error:
        print(f"{name} left out: {error}")
        return False
    return True


def made_by(kind, name, folder):
    """Make the results of a device by the code of a kind of processor."""
    done = run(kind, "bench.processors", "--make", name, folder, capture_output=True, text=True)
    if done.returncode:
        raise ImuloopError(f"{name} as on {kind}: {done.stderr}")


def make(name, device, folder):
    """Make the results of a device."""
    settings = {key: device[key] for key in ("label", "gravity", "nominal", "full_scale", *STAGES)}
    kinds = {session: each["kind"] for session, each in device["sessions"].items()}
    made, failures = Device(name, folder, kinds, **settings), []
    for session, each in device["sessions"].items():
        paths = [source_path(source, CACHE) for source in each["sources"].values()]
        declared = {key: value for key, value in each.items() if key != "kind"}
        failures += chain.ingest(made, session, declared, paths)
    for stage in (chain.segment, chain.noise, chain.calibrate, chain.diagnose):
        failures += stage(made)
    if failures:
        raise ImuloopError(str(failures[0]))


def compared(folder, first, other):
    """Return a line for each figure in which the results of two kinds differ; say the largest."""
    count, largest, faults = 0, 0.0, []
    for path in sorted(Path(folder, first).rglob("*.json")):
        name = path.relative_to(folder / first)
        contents = (json.loads(Path(folder, kind, name).read_text()) for kind in (first, other))
        for place, values, share in differences(*contents):
            count, largest = count + 1, max(largest, share)
            if share > BOUND:
                faults.append(f"{other} beside {first}: {name} {place}: {values[1]}, {values[0]}")
    print(f"{other} beside {first}: {count} values, the largest difference {largest:.2g}")
    return faults


def differences(one, other, place="", size=0.0):
    """Yield place, both values and their difference, share of their size, of all values.

    The size of a number in a list, the end of an interval or a part of a vector, is that of the
    largest there. What is no number differs infinitely or not at all.

    Parameters
    ----------
    one, other
        Contents of JSON files.
    """
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        for key in one:
            yield from differences(one[key], other[key], f"{place}/{key}")
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
    main()
