"""Figures of the noise estimator: `make bench-noise`; `--help` for parts of it."""

import argparse
import multiprocessing
from functools import partial

from bench.noise import accuracy, coverage, detection
from bench.tables import publish

PARTS = {"accuracy": accuracy, "coverage": coverage, "detection": detection}
# records of each scenario beside those of the other parts
MORE = {"coverage": 5}


def document(outcomes):
    """Return the sections of what each part's `run` gave."""
    return "\n\n".join(f"## {PARTS[n].TITLE}\n\n{PARTS[n].text(o)}" for n, o in outcomes.items())


def main():
    """Measure, print and write build/bench/noise.md."""
    parser = argparse.ArgumentParser(prog="python -m bench.noise", description=__doc__)
    parser.add_argument("--seeds", type=int, default=40, help=f"records per scenario, times {MORE}")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--parts", default=",".join(PARTS), help="names, with commas")
    options = parser.parse_args()
    with multiprocessing.get_context("fork").Pool(options.workers) as pool:
        each = partial(pool.imap, chunksize=1)
        outcomes = {
            name: PARTS[name].run(options.seeds * MORE.get(name, 1), each)
            for name in options.parts.split(",")
        }
    publish("noise", "Figures of the noise estimator", document(outcomes))


if __name__ == "__main__":
    main()
