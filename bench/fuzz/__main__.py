"""Mutated logs and configs: does any of them crash, hang, or write outside of its folder?

From the repository, library and tests on the path: ``python -m bench.fuzz --cases 20000``. Each
case is made of its number alone; ``--first N --cases 1`` makes one again and ``--keep FOLDER`` its
file. A worker reads it within 10 s and 1 GB; good ends are a session, a rejected one, or one line
on what is declared wrongly.
"""

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

from bench.fuzz import worker
from bench.fuzz.cases import case
from bench.fuzz.processes import scratch, shared_out
from bench.fuzz.seeds import all_seeds

# s of a case, and cases of a process
SECONDS, BATCH = 10, 500


def fuzz(cases, first=0, only=None, keep=None, workers=2):
    """Run cases in workers; return a Counter of (kind, end), and (number, kind, fault) of each.

    `only` is a kind of log, `keep` a folder for the files of faulty cases.
    """
    ends, faults = Counter(), []
    with scratch() as folder:
        seeds = {k: each for k, each in all_seeds(folder).items() if only in (None, k)}
        numbers, given = range(first, first + cases), (seeds, folder)
        done = shared_out(numbers, workers, SECONDS, worker.serve, *given, batch=BATCH)
        for number, end, found in done:
            kind, name, content, _ = case(number, seeds)
            ends[kind, end] += 1
            faults += [(number, kind, fault) for fault in found]
            if keep and found:
                keep.mkdir(parents=True, exist_ok=True)
                (keep / f"{number}_{name}").write_bytes(content)
    return ends, sorted(faults)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--only", help="one of the kinds of logs")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="folder for the files of faulty cases")
    options = parser.parse_args()
    start = time.monotonic()
    ends, faults = fuzz(**vars(options))
    for kind in sorted({kind for kind, _ in ends}):
        listed = ", ".join(f"{n} {end}" for (k, end), n in sorted(ends.items()) if k == kind)
        print(f"{kind:<12} {listed}")
    print(f"{ends.total()} cases in {time.monotonic() - start:.0f} s, {len(faults)} faulty")
    alike = {}
    for number, *what in faults:
        alike.setdefault(tuple(what), []).append(number)
    for (kind, text), numbers in alike.items():
        print(f"{kind}, case {numbers[0]} and {len(numbers) - 1} more: {text}")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
