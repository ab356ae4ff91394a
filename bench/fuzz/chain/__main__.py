"""Harmed stretches of recordings through the whole chain: is every result of each sound?

From the repository, its library on the path: ``python -m bench.fuzz.chain --cases 3000``. Each case
is made of its number alone; ``--case N`` runs one again, with its traceback, and ``--keep FOLDER``
leaves its log and results there. A case has 60 s of processor time and 1 GB. It is sound if all
result files are there, fit their schemas in workflow/schemas and hold nothing but numbers, and the
report is well-formed.
"""

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from bench.fuzz.chain.cases import make
from bench.fuzz.chain.judge import judge
from bench.fuzz.chain.run import fuzz


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=3000)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--case", type=int, help="run this one alone, without limits")
    parser.add_argument("--keep", type=Path, help="with --case: folder for its log and results")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if options.case is not None:
            return one(options.case, options.keep or Path(folder))
        start, ends, faulty = time.monotonic(), Counter(), 0
        numbers = range(options.first, options.first + options.cases)
        for number, end, faults in fuzz(numbers, options.workers):
            ends[end] += 1
            if not ends.total() % 250:
                seconds = time.monotonic() - start
                print(f"{ends.total()} cases in {seconds:.0f} s, {faulty} faulty", flush=True)
            if faults:
                faulty += 1
                print(f"case {number}, {end}", *make(number, Path(folder)).words, sep="\n  ")
                print(*(f"  ! {fault}" for fault in faults), sep="\n", flush=True)
    print(", ".join(f"{n} {end}" for end, n in sorted(ends.items())))
    print(f"{options.cases} cases in {time.monotonic() - start:.0f} s, {faulty} faulty")
    return bool(faulty)


def one(number, folder):
    """Run one case and say what came out."""
    folder.mkdir(parents=True, exist_ok=True)
    case = make(number, folder)
    print(f"case {number}", *case.words, sep="\n  ", flush=True)
    end, faults = judge(case, folder / "results")
    print(end, *(f"  ! {fault}" for fault in faults), sep="\n")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
