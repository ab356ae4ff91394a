"""Figures of the noise estimator: `make bench-noise`; `--help` for parts of it."""

import argparse
import multiprocessing
import time
from functools import partial
from pathlib import Path

from bench.commit import commit
from bench.noise import accuracy, coverage, curve, detection, published, speed
from bench.noise.document import PARTS, document

# records of each scenario beside those of the accuracy
MORE = 5
# in the short mode: seeds, and rows of the speed
SHORT_SEEDS, SHORT_ROWS = 4, 400_000


def main():
    """Measure and print or write the document."""
    parser = argparse.ArgumentParser(prog="python -m bench.noise", description=__doc__)
    parser.add_argument(
        "--seeds", type=int, default=40, help=f"records a scenario; {MORE} times that for coverage"
    )
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--parts", help=f"names, with commas, of {', '.join(PARTS)}")
    parser.add_argument("--short", action="store_true", help="few seeds, a short day")
    parser.add_argument("--write", type=Path, help="file to write instead of printing")
    options = parser.parse_args()
    seeds = min(options.seeds, SHORT_SEEDS) if options.short else options.seeds
    more = seeds if options.short else MORE * seeds
    rows = SHORT_ROWS if options.short else speed.ROWS
    with multiprocessing.get_context("fork").Pool(options.workers) as pool:
        each = partial(pool.imap, chunksize=1)
        steps = {
            "accuracy": lambda: (accuracy.run(seeds, each), accuracy.bounds()),
            "coverage": lambda: coverage.run(more, each),
            "curve": lambda: curve.run(more, each),
            "detection": lambda: detection.run(seeds, each),
            "published": published.run,
            "speed": lambda: speed.run(rows),
        }
        chosen = options.parts.split(",") if options.parts else list(steps)
        outcomes = {}
        for name in chosen:
            start = time.perf_counter()
            outcomes[name] = steps[name]()
            print(f"{name}: {time.perf_counter() - start:.0f} s", flush=True)
    text = document(outcomes, "make bench-noise", commit(), seeds)
    if options.write:
        options.write.write_text(text, encoding="utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
