"""Errors of N, B and K beside the Cramér–Rao bound and two common ways to read an Allan curve."""

import numpy as np

from bench.noise.bound import relative_bound
from bench.noise.records import RATE, SETTINGS, TERMS, Scenario, by_scenario, estimate, record
from bench.tables import met, share, table
from imuloop.noise.allan import allan_variance, averaging_factors
from imuloop.noise.likelihood import weighted_nnls

TITLE = "Errors beside the bound and beside common tools"
INTRODUCTION = """Relative rms error in %, known to {own:.0%}, over {seeds} records of 3 h at 10 \
Hz of each kind, the same for every estimator. In brackets: in how many records the coefficient is \
given, if not in all, and the error over all with 0 where it is not. The bound is that of the \
exact Gaussian likelihood, its level unknown. The rivals read the curve at log-spaced τ up to a \
third of the record. Required of imuloop: N ≤ {N} %, K ≤ {K} and B ≤ {B} times the bound."""
# 3 h
LENGTH = 108_000
WHITE = Scenario("white noise", {"N": 0.01})
SCENARIOS = (
    Scenario("walk", {"N": 0.01, "K": 1e-4}),
    Scenario("weak walk", {"N": 0.01, "K": 3e-5}),
    Scenario("flicker", {"N": 0.01, "B": 2e-3, "K": 1e-5}),
    WHITE,
)
PRODUCT = "imuloop"
# required: rms error of N in %, of K and B in bounds; share of false K
LIMITS, FALSE = {"N": 0.26, "K": 1.4, "B": 1.3}, 0.05
FLICKER = np.sqrt(2 * np.log(2) / np.pi)


def weighted(tau, variance):
    """Non-negative least squares of Q, N, B, K, R, each point by its error in white noise."""
    design = np.column_stack([3 / tau**2, 1 / tau, FLICKER**2 + 0 * tau, tau / 3, tau**2 / 2])
    theta = weighted_nnls(design, variance, 1 / (np.square(variance) * tau))
    return {name: np.sqrt(value) for name, value in zip("QNBKR", theta, strict=True) if value}


def lines(tau, variance):
    """Lines of fixed slope through the logarithm of the deviation, as `allan_variance_ros` does.

    N: slope -1/2 through tau < 10 s, read at 1 s. K: slope +1/2 through the whole curve, read at
    3 s. It takes 10,000 evenly spaced times up to 1000 s: here each of the log-spaced times counts
    for the evenly spaced ones that it stands for.
    """
    log_tau, log_deviation = np.log(tau), np.log(variance) / 2
    weight = np.where(tau <= 1000, np.gradient(tau), 0)
    white = np.average(log_deviation + log_tau / 2, weights=weight * (tau < 10))
    walk = np.average(log_deviation - log_tau / 2, weights=weight)
    return {"N": np.exp(white), "K": np.sqrt(3) * np.exp(walk)}


RIVALS = {
    "non-negative fit to the curve, weights by each point's error": weighted,
    "lines: −½ below 10 s, +½ through all": lines,
}


def run(seeds, each, length=LENGTH):
    """Return for each scenario the coefficients that each estimator gives of each record."""
    return by_scenario(_one, SCENARIOS, seeds, each, length)


def _one(job):
    scenario, seed, length = job
    x = record(scenario, length, RATE, seed)
    noise = estimate(x, RATE)
    factors = averaging_factors(length, SETTINGS)
    variance = allan_variance([x], factors)
    given = {name: getattr(noise, name).value for name in TERMS}
    found = {PRODUCT: {name: value for name, value in given.items() if value is not None}}
    return found | {name: tool(factors / RATE, variance) for name, tool in RIVALS.items()}


def text(outcomes):
    """Return the introduction, the table of errors, and of terms given that are not there."""
    white, estimators = outcomes[WHITE], (PRODUCT, *RIVALS)
    rows, seeds = [], len(white)
    for scenario, made in outcomes.items():
        bound = relative_bound(scenario, LENGTH, RATE, "".join(scenario.terms))
        for name, truth in scenario.terms.items():
            values = {e: [m[e].get(name) for m in made] for e in estimators}
            cells = [_cell(values[e], truth) for e in estimators]
            least = f"{100 * bound[name]:.3g}"
            # beside flicker this walk is too weak for the record: there to be a nuisance
            weak = "B" in scenario.terms and name == "K"
            good = None if weak else _good(name, _errors(values[PRODUCT], truth), bound[name])
            rows.append((scenario.label, f"{name} = {truth:g}", least, *cells, met(good)))
    false = [
        (name, *(share(sum(m[e].get(name, 0) > 0 for m in white), seeds) for e in estimators))
        for name in "QBKR"
    ]
    introduction = INTRODUCTION.format(seeds=seeds, own=1 / np.sqrt(2 * seeds), **LIMITS)
    head = ("records", "coefficient", "Cramér–Rao bound", *estimators, "met")
    return (
        f"{introduction}\n\n{table(head, rows)}\n\nTerms given of white noise that are not there; "
        f"K of imuloop at most {FALSE:.0%}.\n\n{table(('term', *estimators), false)}"
    )


def _errors(values, truth):
    return np.array([v / truth - 1 for v in values if v is not None])


def _rms(errors):
    return float(np.sqrt(np.mean(np.square(errors))))


def _good(name, errors, bound):
    if not len(errors):
        return False
    return _rms(errors) <= (LIMITS[name] / 100 if name == "N" else LIMITS[name] * bound)


def _cell(values, truth):
    """Return the error of an estimator as text; how often and over all if not always given."""
    given = _errors(values, truth)
    if not len(given):
        return "–"
    every = [(v or 0.0) / truth - 1 for v in values]
    seldom = f" ({len(given)}; {100 * _rms(every):.3g})" if len(given) < len(every) else ""
    return f"{100 * _rms(given):.3g}{seldom}"
