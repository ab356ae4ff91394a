"""Mutated logs and configs: does any of them crash, hang, or write outside of its folder?

From the repository, its library on the path: ``python -m bench.fuzz --cases 20000``. Each case is
made of its number alone; ``--first N --cases 1`` makes one again and ``--keep FOLDER`` its file.
A worker reads it within 10 s and 1 GB; good ends are a session, a rejected one, or one line on
what is declared wrongly.
"""

import argparse
import resource
import sys
import time
from pathlib import Path

from bench.fuzz.run import fuzz


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long")
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
    own, theirs = (
        resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    used = sum(each.ru_utime + each.ru_stime for each in (own, theirs))
    took = f"{time.monotonic() - start:.0f} s, {used:.0f} s of processor time"
    print(f"{ends.total()} cases in {took}, {len(faults)} faulty")
    alike = {}
    for number, kind, text in faults:
        alike.setdefault((kind, text), []).append(number)
    for (kind, text), numbers in alike.items():
        shown = f"{', '.join(map(str, numbers[:5]))}{', …' * (len(numbers) > 5)}"
        print(f"{kind}, case {shown} ({len(numbers)}): {text}")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
