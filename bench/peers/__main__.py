"""Allan curves and noise coefficients beside the packages of the registry: `make bench`."""

import argparse
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from bench.peers import six_faces
from bench.peers.calls import CALLS, RATE, averaging_factors
from bench.peers.contend import contend
from bench.stages import run
from bench.study.tables import table
from imuloop.core.files import read_json
from imuloop.core.samples import CHANNELS, TIME, schema

CURVES = (
    "imuloop",
    "imuloop, intervals",
    "allantools",
    "allan-variance",
    "avar",
    "allan-variance-analyzer",
)
# what each computes
FITS = {
    "imuloop": "Q, N, B, K, R, humps, lines, each tested, with interval or upper limit",
    "allan-variance, fit": "Q, N, B, K, R by least squares",
    "allan-variance-analyzer, fit": "N, K by a line each, B by the minimum",
}
# every so many averaging times are computed in extended precision
EVERY = 10
# of extended precision itself there is no more: below it all agree
DIGITS = 1e-14
# SI, of accelerometer and gyroscope; the walk shows from a minute on
N, K = (1e-3, 1e-4), (2e-5, 2e-6)
MEAN = (0.1, -0.2, 9.8, 0.01, -0.02, 0.03)
REST = {"rest": "static"}


def write(folder, n):
    """Write `n` samples, for the peers and as ingest does: white noise and a random walk."""
    rng, axes = np.random.default_rng(1), np.empty((6, n))
    for i, x in enumerate(axes):
        x[:] = np.cumsum(rng.standard_normal(n) * K[i // 3] / np.sqrt(RATE))
        x += N[i // 3] * np.sqrt(RATE) * rng.standard_normal(n) + MEAN[i]
    np.save(folder / "axes.npy", axes)
    np.save(folder / "factors.npy", averaging_factors(n))
    columns = {TIME: np.arange(n) / RATE, **dict(zip(CHANNELS, axes, strict=True))}
    (folder / "rest").mkdir()
    samples = pa.table(columns).cast(schema(False, {}))
    pq.write_table(samples, folder / "rest/samples.parquet", row_group_size=1 << 17)


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


def rounds(contenders, count):
    """Return the results by contender of so many rounds, in each of which they take turns."""
    found = {name: [] for name in contenders}
    for _ in range(count):
        for name, each in contenders.items():
            if not (found[name] and isinstance(found[name][-1], str)):
                found[name].append(each())
            print(f"{name}: {found[name][-1]}", file=sys.stderr, flush=True)
    return found


def compare(folder, n, count, environment):
    """Return the results of all on `n` samples: seconds of each round, memory, differences."""
    write(folder, n)
    run("segment", folder, REST)
    contenders = {name: partial(contend, name, folder, environment) for name in CALLS}

    def stage():
        took = run("noise", folder, REST)
        return {"seconds": took["work"], "memory": took["memory"], "version": None}

    found = rounds({**contenders, "noise stage": stage}, count)
    axes, factors = (np.load(folder / f"{name}.npy") for name in ("axes", "factors"))
    true, outcome = reference(axes, factors[::EVERY]), {"n": n, "factors": len(factors)}
    stored = read_json(folder / "noise.json")["axes"]
    for name, each in found.items():
        if isinstance(each[-1], str):
            outcome[name] = each[-1]
            continue
        seconds = [one["seconds"] for one in each]
        outcome[name] = {**each[-1], "best": min(seconds)}
        if name == "noise stage":
            values = [
                [stored[axis][term]["value"] or 0.0 for term in "NK"] for axis in CHANNELS[:3]
            ]
        else:
            values = np.load(folder / f"{name}.npy")
        if name == "noise stage" or name.endswith("fit"):
            error = np.abs(np.array(values) / [N[0], K[0]] - 1)
            outcome[name]["error"] = error.max(axis=0).tolist()
        else:
            outcome[name]["difference"] = float(np.abs(values[:, ::EVERY] / true - 1).max())
    if not isinstance(outcome["allantools"], str):
        mine, theirs = (np.load(folder / f"{name}.npy") for name in ("imuloop", "allantools"))
        outcome["agreement"] = float(np.abs(mine / theirs - 1).max())
    return outcome


def timed(outcomes, name, base):
    """Return a cell an outcome: s of the best round, and as a multiple of those of `base`."""
    cells = []
    for outcome in outcomes:
        each = outcome[name]
        if isinstance(each, str):
            cells.append(f"failed: {each}")
        else:
            ratio = each["best"] / outcome[base]["best"]
            cells.append(f"{each['best']:.3g} ({ratio:.2f} ×)")
    return cells


def last(outcomes, name, key, text):
    """Return a figure of the largest record that a contender came through, as text."""
    each = [o[name][key] for o in outcomes if not isinstance(o[name], str)]
    return text(each[-1]) if each else "–"


def label(outcomes, name):
    """Return a contender's name with its version."""
    if not (distribution := CALLS[name][1]):
        return f"**{name}**"
    return f"{distribution} {last(outcomes, name.removesuffix(', fit'), 'version', str)}"


def curves(outcomes):
    """Return the table of the Allan curves."""
    rows = [
        (
            label(outcomes, name),
            *timed(outcomes, name, "imuloop, intervals"),
            last(outcomes, name, "difference", lambda x: f"{x:.0e}" if x > DIGITS else "< 1e-14"),
            last(outcomes, name, "memory", lambda x: f"{x / 1e6:.0f} MB"),
        )
        for name in CURVES
    ]
    sizes = [f"{o['n']:,} × 6, {o['factors']} τ, s" for o in outcomes]
    return table(("", *sizes, "largest relative difference", "memory"), rows)


def fits(outcomes):
    """Return the table of the noise coefficients."""
    rows = []
    for name, what in FITS.items():
        key = "noise stage" if name == "imuloop" else name
        errors = last(outcomes, key, "error", lambda e: ", ".join(f"{x:.1%}" for x in e))
        shown = "**imuloop, noise stage**" if name == "imuloop" else label(outcomes, name)
        rows.append((shown, *timed(outcomes, key, "noise stage"), errors, what))
    sizes = (f"{o['n']:,} × 6, s" for o in outcomes)
    header = ("", *sizes, "largest error of N, K", "computes")
    return table(header, rows)


def main():
    parser = argparse.ArgumentParser(prog="python -m bench.peers", description=__doc__)
    parser.add_argument("--sizes", default="100000,1000000,3060000", help="samples, with commas")
    parser.add_argument("--rounds", type=int, default=3, help="the best counts")
    parser.add_argument("--environment", type=Path, default=Path("build/bench"), help="the peers'")
    options = parser.parse_args()
    outcomes = []
    for n in map(int, options.sizes.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            outcomes.append(compare(Path(folder), n, options.rounds, options.environment))
    both = [o for o in outcomes if "agreement" in o]
    shares = [f"{o['imuloop, intervals']['best'] / o['allantools']['best']:.2f}" for o in both]
    apart = [f"{o['agreement']:.1e}" for o in both]
    beside = (
        f" imuloop with intervals takes {', '.join(shares)} of the time of `allantools.oadev`; at "
        f"all τ the deviations differ by at most {', '.join(apart)}."
    )
    print(
        f"### Allan curve of six axes\n\n{curves(outcomes)}\n\n"
        "In brackets the time as a multiple of that of imuloop with intervals. Differences are "
        "those of the longest record to the deviation in extended precision, at every "
        f"{EVERY}th τ; allan-variance-analyzer does not overlap. Freed memory stays with each "
        "process, which favours the peers."
        f"{beside if both else ''}\n\n"
        f"### Noise coefficients\n\n{fits(outcomes)}\n\n"
        f"Errors are of the longest record, of the accelerometer's worst axis; true are N {N[0]:g} "
        f"m/s²/√Hz and K {K[0]:g} m/s³/√Hz.\n\n"
        f"### Six faces\n\n{six_faces.compare(options.rounds, options.environment)}"
    )


if __name__ == "__main__":
    main()
