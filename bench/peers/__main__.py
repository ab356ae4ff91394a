"""Allan curves, and noise of a log at rest, beside the packages of the registry: `make bench`."""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from bench.peers.calls import CURVES, NOISE, RATE, averaging_factors
from bench.peers.log import RATE as LOG_RATE
from bench.peers.log import still_log
from bench.tables import REPOSITORY, publish, table

# every so many averaging times are computed in extended precision
EVERY = 10
# SI, white noise and random walk of accelerometer and gyroscope
N, K = (1e-3, 1e-4), (2e-5, 2e-6)
# freed memory stays with the process: else page faults of temporaries count, or not, by chance
ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONPATH": os.pathsep.join([str(REPOSITORY / "workflow/lib"), str(REPOSITORY)]),
    "MALLOC_MMAP_THRESHOLD_": str(1 << 25),
    "MALLOC_TRIM_THRESHOLD_": str(1 << 32),
}


def contend(calls, arrays, environment, rounds):
    """Yield contender, least seconds of the rounds and what it computed, or why it failed.

    Contenders take turns, each in its own process, imuloop in this environment, peers in
    their own; `arrays` by name are what they are given.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, values in arrays.items():
            np.save(f"{folder}/{name}.npy", values)
        took, failed = {}, {}
        for peer in [*calls] * rounds:
            python = sys.executable if peer == "imuloop" else environment / "bin/python"
            command = [str(python), "-m", "bench.peers.calls", calls[peer].__name__, folder]
            how = {"env": os.environ | ENVIRONMENT, "capture_output": True, "text": True}
            done = subprocess.run(command, **how)
            if done.returncode:
                failed[peer] = done.stderr.strip().splitlines()[-1]
            else:
                took.setdefault(peer, []).append(float(done.stdout))
        for peer, call in calls.items():
            if peer in failed:
                yield peer, None, failed[peer]
            else:
                yield peer, min(took[peer]), np.load(f"{folder}/{call.__name__}.npy")


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


def curves(n, environment, rounds):
    """Return the table of the Allan curves of six axes of `n` samples, and their differences."""
    rng, axes, factors = np.random.default_rng(1), np.empty((6, n)), averaging_factors(n)
    for i, x in enumerate(axes):
        x[:] = np.cumsum(rng.standard_normal(n) * K[i // 3] / np.sqrt(RATE))
        x += N[i // 3] * np.sqrt(RATE) * rng.standard_normal(n) + 9.8 * (i == 2)
    rows, true = [], reference(axes, factors[::EVERY])
    arrays = {"axes": axes, "factors": factors}
    for peer, took, made in contend(CURVES, arrays, environment, rounds):
        if took is None:
            rows.append((peer, f"failed: {made}", "–"))
        else:
            off = np.abs(made[:, ::EVERY] / true - 1).max()
            rows.append((peer, f"{took:.3g}", f"{off:.0e}"))
    size = f"{n:,} × 6, {len(factors)} τ"
    return table((size, "processor time, s", "largest relative difference"), rows)


def noise(hours, seeds, environment):
    """Return the tables of the noise that each finds in logs at rest, plain and behind a filter."""
    rows, n = [], round(hours * 3600 * LOG_RATE)
    for behind_filter in (False, True):
        took, errors, failed = {}, {}, {}
        for seed in seeds:
            truth, axes = still_log([seed, behind_filter], n, behind_filter)
            for peer, seconds, made in contend(NOISE, {"axes": axes}, environment, 1):
                if seconds is None:
                    failed[peer] = made
                else:
                    took.setdefault(peer, []).append(seconds)
                    errors.setdefault(peer, []).append(np.abs(made / truth - 1))
        which = "behind a low-pass" if behind_filter else "no filter"
        for peer in NOISE:
            if peer in failed:
                rows.append((peer, which, f"failed: {failed[peer]}", *"–––"))
            else:
                found = np.concatenate(errors[peer])
                rows.append((peer, which, f"{np.median(took[peer]):.3g}", *map(shown, found.T)))
    size = f"{len(seeds)} × {hours:g} h, {LOG_RATE:g} Hz, six axes"
    return table((size, "log", "processor time, s", "N", "B", "K"), rows)


def shown(errors):
    """Return the median of relative errors, and of how many it is where some are missing."""
    known = errors[np.isfinite(errors)]
    if not len(known):
        return "–"
    part = f" ({len(known)} of {len(errors)})" if len(known) < len(errors) else ""
    return f"{100 * np.median(known):.2g} %{part}"


def main():
    parser = argparse.ArgumentParser(prog="python -m bench.peers", description=__doc__)
    parser.add_argument("--sizes", default="100000,1000000,3060000", help="samples, with commas")
    parser.add_argument("--rounds", type=int, default=3, help="the best counts")
    parser.add_argument("--hours", type=float, default=3.0, help="of a log at rest")
    parser.add_argument("--seeds", default="1", help="of logs at rest, with commas")
    parser.add_argument("--environment", type=Path, default=Path("build/peers"), help="the peers'")
    options = parser.parse_args()
    how = options.environment, options.rounds
    text = (
        "Versions are those of `bench/requirements.txt`; the best of rounds.",
        "## Allan curve of six axes",
        *(curves(int(n), *how) for n in options.sizes.split(",") if n),
        "imuloop with intervals, which the others do not give. Differences are those to extended "
        f"precision, at every {EVERY}th τ. Freed memory stays with each process, which favours "
        "the peers.",
        "## Noise of a log at rest",
        noise(options.hours, [int(s) for s in options.seeds.split(",")], options.environment),
        "Median error of the axes; of time, of the logs. imuloop by the noise and the Allan stage. "
        "allan-variance-analyzer takes the minimum of the curve for B. dedrunk gives no B, and "
        "nothing where it sees no walk; its time includes the reading of a file.",
    )
    publish("peers", "Beside other packages", "\n\n".join(text))


if __name__ == "__main__":
    main()
