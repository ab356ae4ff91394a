"""Allan curves and six faces beside the packages of the registry: `make bench`."""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

from bench.peers import six_faces
from bench.peers.calls import CURVES, RATE, averaging_factors
from bench.peers.contend import contend
from bench.study.tables import table

# every so many averaging times are computed in extended precision
EVERY = 10
# of extended precision itself there is no more: below it all agree
DIGITS = 1e-14
# SI, white noise and random walk of accelerometer and gyroscope
N, K = (1e-3, 1e-4), (2e-5, 2e-6)
BASE = "imuloop, intervals"


def write(folder, n):
    """Write `n` samples of six axes, a white noise and a random walk each, and the factors."""
    rng, axes = np.random.default_rng(1), np.empty((6, n))
    for i, x in enumerate(axes):
        x[:] = np.cumsum(rng.standard_normal(n) * K[i // 3] / np.sqrt(RATE))
        x += N[i // 3] * np.sqrt(RATE) * rng.standard_normal(n) + 9.8 * (i == 2)
    np.save(folder / "axes.npy", axes)
    np.save(folder / "factors.npy", averaging_factors(n))


def reference(axes, factors):
    """Return the overlapping Allan deviation in extended precision, shape (6, k)."""
    found = np.empty((len(axes), len(factors)))
    for i, x in enumerate(axes):
        total = np.zeros(len(x) + 1, dtype=np.longdouble)
        np.cumsum(x.astype(np.longdouble) - x.mean(), out=total[1:])
        for k, m in enumerate(factors):
            second = total[2 * m :] - 2 * total[m:-m] + total[: -2 * m]
            found[i, k] = np.sqrt((second @ second) / len(second) / 2) / m
    return found


def compare(n, rounds, environment):
    """Return what each contender did with `n` samples, or why it failed: the best of rounds."""
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        write(folder, n)
        made = [
            {name: contend(name, folder, environment) for name in CURVES} for _ in range(rounds)
        ]
        axes, factors = (np.load(folder / f"{name}.npy") for name in ("axes", "factors"))
        true, found = reference(axes, factors[::EVERY]), {}
        for name in CURVES:
            each = [one[name] for one in made]
            if failed := next((one for one in each if isinstance(one, str)), None):
                found[name] = failed
                continue
            off = np.abs(np.load(folder / f"{name}.npy")[:, ::EVERY] / true - 1).max()
            best = min(each, key=lambda one: one["seconds"])
            found[name] = best | {"difference": f"{off:.0e}" if off > DIGITS else "< 1e-14"}
    return found, f"{n:,} × 6, {len(factors)} τ, s"


def curves(outcomes):
    """Return the table of the Allan curves: differences and memory are of the longest record."""
    rows = []
    for name, (_, distribution) in CURVES.items():
        cells, last = [], None
        for found, _ in outcomes:
            if isinstance(found[name], str):
                cells.append(f"failed: {found[name]}")
                continue
            last, base = found[name], found[BASE]["seconds"]
            cells.append(f"{last['seconds']:.3g} ({last['seconds'] / base:.2f}×)")
        shown = distribution or f"**{name}**"
        if last and distribution:
            shown += f" {last['version']}"
        more = (last["difference"], f"{last['memory'] / 1e6:.0f} MB") if last else "––"
        rows.append((shown, *cells, *more))
    sizes = [size for _, size in outcomes]
    return table(("", *sizes, "largest relative difference", "memory"), rows)


def main():
    parser = argparse.ArgumentParser(prog="python -m bench.peers", description=__doc__)
    parser.add_argument("--sizes", default="100000,1000000,3060000", help="samples, with commas")
    parser.add_argument("--rounds", type=int, default=3, help="the best counts")
    parser.add_argument("--environment", type=Path, default=Path("build/bench"), help="the peers'")
    options = parser.parse_args()
    outcomes = []
    for n in map(int, options.sizes.split(",")):
        print(f"{n} samples", file=sys.stderr, flush=True)
        outcomes.append(compare(n, options.rounds, options.environment))
    print(
        f"### Allan curve of six axes\n\n{curves(outcomes)}\n\n"
        "In brackets multiples of imuloop with intervals. Differences are those of the longest "
        f"record to extended precision, at every {EVERY}th τ; allan-variance-analyzer does not "
        "overlap. Freed memory stays with each process, which favours the peers.\n\n"
        f"### Six faces\n\n{six_faces.compare(options.rounds, options.environment)}"
    )


if __name__ == "__main__":
    main()
