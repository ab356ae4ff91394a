"""Errors of N, B and K beside the Cramér–Rao bound and common tools, all on the same records."""

from functools import cache

import numpy as np

from bench.noise.bound import relative_bound
from bench.noise.records import RATE, TERMS, Scenario, by_scenario, curve_of, estimate, record
from bench.noise.rivals import RIVALS
from bench.study.tables import share, table
from imuloop.noise.allan import allan_variance

TITLE = "Errors beside the bound and beside common tools"
INTRODUCTION = """
Records of 3 h at 10 Hz, made by `imuloop.simulate.noise`; every estimator reads the same ones.
Relative rms error over the records in which the estimator gives the coefficient, and over all with
0 where it gives none. With {seeds} records an rms error is itself known to {own:.0%}. The bound is
that of the exact Gaussian likelihood, from dense covariances (`bench/noise/bound.py`). The rivals
(`bench/noise/rivals.py`) read the curve at log-spaced τ up to a third of the record."""
# 3 h
LENGTH = 108_000
WHITE = Scenario("white noise alone", {"N": 0.01})
# what the bound takes as unknown beside the level
SCENARIOS = {
    Scenario("walk, K = 1e-4", {"N": 0.01, "K": 1e-4}): "NK",
    Scenario("weak walk, K = 3e-5", {"N": 0.01, "K": 3e-5}): "NK",
    Scenario("flicker, B = 2e-3, and K = 1e-5", {"N": 0.01, "B": 2e-3, "K": 1e-5}): "NBK",
    WHITE: "N",
}
PRODUCT = "imuloop"
# of the requirement: rms error of N in %, of K and B in bounds; share of false K
LIMITS = {"N": 0.26, "K": 1.4, "B": 1.3, "false": 0.05}


def run(seeds, each, length=LENGTH):
    """Return for each scenario the coefficients that each estimator gives of each record.

    Beside them, ``"others"``, how many processes imuloop names.
    """
    return by_scenario(_one, SCENARIOS, seeds, each, length)


def _one(job):
    scenario, seed, length = job
    x = record(scenario, length, RATE, seed)
    noise = estimate(x, RATE)
    factors, _ = curve_of(length, RATE)
    variance = allan_variance([x], factors)
    given = {name: getattr(noise, name).value for name in TERMS}
    found = {PRODUCT: {name: value for name, value in given.items() if value is not None}}
    found |= {name: tool(factors / RATE, variance) for name, tool in RIVALS.items()}
    return {**found, "others": len(noise.gauss_markov) + len(noise.sinusoid)}


def _rms(errors):
    return float(np.sqrt(np.mean(np.square(errors))))


def _errors(made, estimator, name, truth):
    """Return relative errors of one coefficient: where given, and of all with 0 where not."""
    found = [m[estimator].get(name) for m in made]
    given = [v / truth - 1 for v in found if v is not None]
    return np.array(given), np.array([(v or 0.0) / truth - 1 for v in found])


def _false(made, estimator, name):
    return sum(m[estimator].get(name, 0) > 0 for m in made)


def text(outcomes):
    """Return the introduction and the tables, one a scenario and one of false terms."""
    seeds = len(outcomes[WHITE])
    parts = [" ".join(INTRODUCTION.format(seeds=seeds, own=1 / np.sqrt(2 * seeds)).split())]
    for scenario, made in outcomes.items():
        least, head, row = _bound(scenario), ["estimator"], ["**Cramér–Rao bound**"]
        for name in scenario.terms:
            head += [f"{name}: rms error, %", "given", "all, 0 if not given"]
            row += [f"{100 * least[name]:.3g}", "", ""]
        rows = [_row(estimator, made, scenario.terms) for estimator in (PRODUCT, *RIVALS)]
        unknown = ", ".join((*SCENARIOS[scenario], "level"))
        truth = ", ".join(f"{name} = {value:g}" for name, value in scenario.terms.items())
        title = f"{scenario.label[0].upper()}{scenario.label[1:]}: {truth}; {len(made)} records."
        parts += [f"{title} The bound takes as unknown: {unknown}.", table(head, [*rows, row])]
    white = outcomes[WHITE]
    rows = [
        [estimator, *(share(_false(white, estimator, n), len(white)) for n in "QBKR")]
        for estimator in (PRODUCT, *RIVALS)
    ]
    parts.append("Terms that are not there, given for white noise:")
    parts.append(table(("estimator", *"QBKR"), rows))
    other = sum(m["others"] > 0 for m in white)
    parts.append(f"Humps and lines in white noise, imuloop: {share(other, len(white))}.")
    return "\n\n".join(parts)


@cache
def _bound(scenario):
    return relative_bound(scenario, LENGTH, RATE, SCENARIOS[scenario])


def _row(estimator, made, truth):
    row = [estimator]
    for name, value in truth.items():
        given, every = _errors(made, estimator, name, value)
        if len(given):
            count = f"{len(given)} of {len(made)}"
            row += [f"{100 * _rms(given):.3g}", count, f"{100 * _rms(every):.3g}"]
        else:
            row += ["–", "0", "–"]
    return row


def checks(outcomes):
    """Yield what is required, its bound, what was found and whether it is met."""
    for scenario, made in outcomes.items():
        for name, truth in scenario.terms.items():
            given, _ = _errors(made, PRODUCT, name, truth)
            if scenario.terms.get("B") and name == "K":
                continue  # too weak for this record: there to be a nuisance
            what = f"{name}, rms error, {scenario.label}"
            if not len(given):
                yield what, "identifiable", f"0 of {len(made)}", False
            elif name == "N":
                found = 100 * _rms(given)
                yield what, f"≤ {LIMITS['N']} %", f"{found:.3g} %", found <= LIMITS["N"]
            else:
                ratio = _rms(given) / _bound(scenario)[name]
                seen = f"{ratio:.2f} × ({len(given)} of {len(made)} identifiable)"
                yield what, f"≤ {LIMITS[name]} × the bound", seen, ratio <= LIMITS[name]
    white, limit = outcomes[WHITE], LIMITS["false"]
    false = _false(white, PRODUCT, "K")
    yield (
        "K from white noise",
        f"≤ {limit:.0%}",
        share(false, len(white)),
        false <= limit * len(white),
    )
