"""Figures of the noise estimator: `make bench-noise`; `--help` for parts of it."""

import argparse
import multiprocessing
import platform
import time
from functools import partial
from pathlib import Path

import numpy as np
import scipy

from bench.commit import commit
from bench.noise import accuracy, coverage, detection
from bench.study.tables import table

PARTS = {"accuracy": accuracy, "coverage": coverage, "detection": detection}
# records of each scenario beside those of the other parts
MORE = {"coverage": 5}


def document(outcomes, made_of):
    """Return docs/noise_figures.md of what each part's `run` gave, and the commit."""
    head = (
        f"Written by `make bench-noise`, never by hand: commit {made_of}, "
        f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}."
    )
    checks = [c for name, outcome in outcomes.items() for c in PARTS[name].checks(outcome)]
    sections = [
        ("# Figures of the noise estimator", head),
        ("## Against the bounds", bounds(checks)),
        *((f"## {PARTS[name].TITLE}", PARTS[name].text(each)) for name, each in outcomes.items()),
    ]
    return "\n\n".join(f"{title}\n\n{text}" for title, text in sections) + "\n"


def bounds(checks):
    """Return the table of the bounds: how many checks met each, and those that did not."""
    rows = []
    for what, bound in dict.fromkeys(check[:2] for check in checks):
        each = [check[2:] for check in checks if check[:2] == (what, bound)]
        missed = [f"{case}: {found}" for case, found, met in each if met is not None and not met]
        few = sum(met is None for *_, met in each)
        missed += [f"{few} cannot tell: too few records"] * bool(few)
        met = sum(bool(met) for *_, met in each)
        rows.append((what, bound, f"{met} of {len(each)}", "; ".join(missed) or "–"))
    return table(("what", "bound", "met", "not met"), rows)


def main():
    """Measure and print or write the document."""
    parser = argparse.ArgumentParser(prog="python -m bench.noise", description=__doc__)
    parser.add_argument("--seeds", type=int, default=40, help=f"records per scenario, times {MORE}")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--parts", help=f"names, with commas, of {', '.join(PARTS)}")
    parser.add_argument("--write", type=Path, help="file to write instead of printing")
    options = parser.parse_args()
    outcomes = {}
    with multiprocessing.get_context("fork").Pool(options.workers) as pool:
        for name in options.parts.split(",") if options.parts else PARTS:
            start, seeds = time.perf_counter(), options.seeds * MORE.get(name, 1)
            outcomes[name] = PARTS[name].run(seeds, partial(pool.imap, chunksize=1))
            print(f"{name}: {time.perf_counter() - start:.0f} s", flush=True)
    text = document(outcomes, commit())
    if options.write:
        options.write.write_text(text, encoding="utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
