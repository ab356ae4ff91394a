"""Mutated logs and configs: does any of them crash, hang, or write outside of its folder?

From the repository, its library on the path: ``python -m bench.fuzz --cases 20000``. Each case is
made of its number alone; ``--first N --cases 1`` makes one again and ``--keep FOLDER`` its file.
A worker reads it within 10 s and 2 GB; good ends are a session, a rejected one, or one line on
what is declared wrongly.
"""

import argparse
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
    parser.add_argument("--keep", type=Path, help="folder for the files of faulty cases")
    options = parser.parse_args()
    start = time.monotonic()
    ends, faults = fuzz(**vars(options))
    for kind in sorted({kind for kind, _ in ends}):
        listed = ", ".join(f"{n} {end}" for (k, end), n in sorted(ends.items()) if k == kind)
        print(f"{kind:<12} {listed}")
    print(f"{ends.total()} cases in {time.monotonic() - start:.0f} s, {len(faults)} faulty")
    for number, kind, text in faults:
        print(f"case {number}, {kind}: {text}")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
