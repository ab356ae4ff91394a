"""Which estimator of noise coefficients? Prints the comparison: `python -m bench.noise.methods`."""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import dctn

from bench.noise.estimators import (
    TERMS,
    blocks,
    bound,
    cosine,
    curve,
    dense,
    diagonal_loss,
    estimate,
    fourier,
    sine,
    sine_taper,
    standard_errors,
    wavelet,
)
from bench.noise.records import RATE, Scenario, record
from imuloop.noise.modes import expected_squares
from imuloop.noise.processes import distances, mean_covariances

# 3 h: the handbook's records
LENGTH = 108_000
SCENARIOS = (
    Scenario("K = 1e-4", {"N": 0.01, "K": 1e-4}),
    Scenario("K = 3e-5", {"N": 0.01, "K": 3e-5}),
    Scenario("B = 2e-3", {"N": 0.01, "B": 2e-3}),
    Scenario("white", {"N": 0.01}),
)
LARGE = 10**7
# Hz; that of the hump which the handbook knows of one accelerometer
LINE = 0.08
HEADER = (
    "estimator",
    "N, %",
    "K = 1e-4, %",
    "K = 3e-5, %",
    "B = 2e-3, %",
    "K of white noise, 1e-6",
    "set-up, s",
    "a record, ms",
    "10⁷ samples, s",
    "gaps",
    "ramp",
    "other processes",
)


@dataclass(frozen=True)
class Contestant:
    """An estimator of the table.

    Attributes
    ----------
    name : str
        First column.
    make : callable
        Length and rate, Hz, to a Method.
    traits : tuple of str
        What it does with gaps, a ramp, and processes other than N, B, K.
    terms : str
        Those that it can fit.
    scales : bool
        Whether a long record is within reach.
    """

    name: str
    make: Callable
    traits: tuple[str, str, str]
    terms: str = TERMS
    scales: bool = True


CONTESTANTS = (
    Contestant(
        "exact likelihood of differences, DST-I",
        sine,
        ("each stretch alone", "fitted, with sign", "none"),
        terms="NK",
    ),
    Contestant(
        "exact likelihood of 5 s means, dense",
        dense,
        ("any", "fitted, with sign", "any, n³ a step"),
        terms="NB",
        scales=False,
    ),
    Contestant(
        "plain Whittle, differences",
        lambda n, rate: fourier(n, rate, debiased=False),
        ("no", "drops out", "any spectrum"),
    ),
    Contestant("debiased Whittle, differences", fourier, ("mask", "drops out", "any covariance")),
    Contestant(
        "the same, sine taper",
        lambda n, rate: fourier(n, rate, taper=sine_taper),
        ("mask", "leaks", "any covariance"),
    ),
    Contestant(
        "debiased Whittle, cosines",
        cosine,
        ("each stretch alone", "fitted, with sign", "any covariance"),
    ),
    Contestant(
        "the same in blocks (used)",
        blocks,
        ("means keep their place", "fitted, with sign", "any covariance"),
    ),
    Contestant(
        "GMWM, full covariance",
        wavelet,
        ("pooled within stretches", "R² beside K²", "octaves; a covariance each"),
    ),
    Contestant(
        "NNLS on the curve, by variance of the points",
        lambda n, rate: curve(n, rate, relative=False),
        ("pooled within stretches", "R² beside K²", "by their curve"),
    ),
    Contestant(
        "NNLS on the curve, relative residuals",
        curve,
        ("pooled within stretches", "R² beside K²", "by their curve"),
    ),
)


def score(contestant, seeds):
    """Return a row: relative rms errors with the terms of the truth fitted, K of white, times."""
    start = time.perf_counter()
    method = contestant.make(LENGTH, RATE)
    setup = time.perf_counter() - start
    errors, white, spent = [], [], []
    for scenario in SCENARIOS:
        truth = np.array([scenario.terms.get(t, 0.0) for t in TERMS])
        terms = "".join(scenario.terms)
        if not set(terms) <= set(contestant.terms):
            errors.append(np.full(3, np.nan))
            continue
        found = []
        for seed in range(seeds):
            x = record(scenario, LENGTH, RATE, seed)
            start = time.perf_counter()
            found.append(estimate(method, x, terms))
            spent.append(time.perf_counter() - start)
            if terms == "N" and "K" in contestant.terms:
                white.append(estimate(method, x, "NK")[2])
        relative = np.divide(found, truth, out=np.full((seeds, 3), np.nan), where=truth > 0) - 1
        errors.append(np.sqrt((relative**2).mean(axis=0)))
    white = 1e6 * np.sqrt(np.mean(np.square(white))) if white else np.nan
    return [*columns(errors), white, setup, 1e3 * np.mean(spent)]


def columns(errors):
    """Return N, the worst of the scenarios, K, K and B in per cent, of errors shape (4, 3)."""
    errors = 100 * np.asarray(errors)
    return [np.nanmax(errors[:, 0]), errors[0, 2], errors[1, 2], errors[2, 1]]


def bounds(method):
    """Return the row of expected errors of a Method."""
    found = [bound(method, scenario.terms) for scenario in SCENARIOS]
    return columns([[b.get(t, np.nan) for t in TERMS] for b in found])


def large(contestant):
    """Return the seconds for N and K of one long record, set-up and fit."""
    x = record(SCENARIOS[0], LARGE, RATE, 0)
    start = time.perf_counter()
    estimate(contestant.make(LARGE, RATE), x, "NK")
    return time.perf_counter() - start


def line_loss(frequency):
    """Return how many times the power a line needs in GMWM to stand out as in the cosines.

    Beside N and K = 1e-4 of unknown size, where the line is weak.
    """
    truth = SCENARIOS[0].terms
    theta = np.array([truth.get(t, 0.0) for t in TERMS]) ** 2
    cosines, moments = cosine(LENGTH, RATE), wavelet(LENGTH, RATE)
    angle = np.pi * frequency * 2 ** np.arange(len(moments.expected)) / RATE
    allan = np.sin(angle) ** 4 / angle**2
    squares = expected_squares(np.cos(2 * np.pi * frequency * np.arange(LENGTH) / RATE) / 2)
    least, needed = (
        standard_errors(
            replace(method, expected=np.column_stack([method.expected, line])), theta, [0, 2, 3]
        )[-1]
        for method, line in ((cosines, squares), (moments, allan))
    )
    return needed / least


def flicker_loss(m=50):
    """Return the error of B in cosines over that of the exact likelihood, both in block means."""
    truth = SCENARIOS[2].terms
    units = mean_covariances(distances(m * np.arange(LENGTH // m)), m, 1 / RATE)[1:3]
    units = dctn(units, norm="ortho", axes=(1, 2))[:, 1:, 1:]
    return diagonal_loss(units, np.array([truth["N"], truth["B"]]) ** 2)[1]


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.noise.methods", description=__doc__)
    parser.add_argument("--seeds", type=int, default=40, help="records of each scenario")
    parser.add_argument("--short", action="store_true", help="without the record of 10⁷ samples")
    options = parser.parse_args()
    print_row(HEADER)
    print_row(["---"] + ["---:"] * 8 + ["---"] * 3)
    expected = {
        "Cramér–Rao bound": cosine,
        "cosines in blocks, expected": blocks,
        "GMWM, expected": wavelet,
    }
    for name, make in expected.items():
        print_row([name, *(number(v, 3) for v in bounds(make(LENGTH, RATE))), *[""] * 7])
    for contestant in CONTESTANTS:
        row = score(contestant, options.seeds)
        row.append(large(contestant) if contestant.scales and not options.short else np.nan)
        row = [*(number(v, 3) for v in row[:4]), *row[4:]]
        print_row([contestant.name, *row, *contestant.traits])
    line, flicker = number(line_loss(LINE)), number(100 * (flicker_loss() - 1))
    print(f"\nA weak line at {LINE} Hz needs {line} times the power in the octaves of GMWM.")
    print(f"That flicker correlates the cosines costs the error of B {flicker} %.")


def print_row(cells):
    """Print one line of a markdown table."""
    print("| " + " | ".join(c if isinstance(c, str) else number(c) for c in cells) + " |")
    sys.stdout.flush()


def number(value, digits=2):
    """Return that many digits, or a dash for what there is not."""
    return "–" if np.isnan(value) else f"{float(f'{value:.{digits}g}'):g}"


if __name__ == "__main__":
    main()
