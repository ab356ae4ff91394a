"""Errors of N, B and K beside the Cramér–Rao bound and common tools, all on the same records."""

from functools import cache

import numpy as np

from bench.noise.bound import relative_bound
from bench.noise.records import RATE, SETTINGS, TERMS, Scenario, by_scenario, estimate, record
from bench.noise.rivals import RIVALS
from bench.study.tables import share, table
from imuloop.noise.allan import allan_variance, averaging_factors

TITLE = "Errors beside the bound and beside common tools"
INTRODUCTION = """
Relative rms error in %, known to {own:.0%}, over {seeds} records of 3 h at 10 Hz of each kind, the
same for every estimator. In brackets: in how many records the coefficient is given, if not in all,
and the error over all with 0 where it is not. “False”: records in which a term is given that is not
there. The bound is that of the exact Gaussian likelihood, its level unknown. The rivals
(`bench/noise/rivals.py`) read the curve at log-spaced τ up to a third of the record."""
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
# of the requirement: rms error of N in %, of K and B in bounds; share of false K
LIMITS = {"N": 0.26, "K": 1.4, "B": 1.3, "false": 0.05}


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
    found |= {name: tool(factors / RATE, variance) for name, tool in RIVALS.items()}
    return found


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
    """Return the introduction and the table of errors and of false terms."""
    white, estimators = outcomes[WHITE], (PRODUCT, *RIVALS)
    seeds = len(white)
    rows = []
    for scenario, made in outcomes.items():
        for name, value in scenario.terms.items():
            cells = [_cell(*_errors(made, estimator, name, value)) for estimator in estimators]
            least = f"{100 * _bound(scenario)[name]:.3g}"
            rows.append((scenario.label, f"{name} = {value:g}", least, *cells))
    for name in "QBKR":
        false = (f"{_false(white, estimator, name)}/{seeds}" for estimator in estimators)
        rows.append((WHITE.label, f"false {name}", "–", *false))
    introduction = INTRODUCTION.format(seeds=seeds, own=1 / np.sqrt(2 * seeds))
    head = ("records", "coefficient", "Cramér–Rao bound", *estimators)
    return f"{' '.join(introduction.split())}\n\n{table(head, rows)}"


@cache
def _bound(scenario):
    return relative_bound(scenario, LENGTH, RATE, "".join(scenario.terms))


def _cell(given, every):
    """Return the error of an estimator as text; how often and over all if not always given."""
    if not len(given):
        return "–"
    seldom = f" ({len(given)}; {100 * _rms(every):.3g})" if len(given) < len(every) else ""
    return f"{100 * _rms(given):.3g}{seldom}"


def checks(outcomes):
    """Yield what is required, its bound, of which case, what was found and whether it is met."""
    for scenario, made in outcomes.items():
        for name, truth in scenario.terms.items():
            given, _ = _errors(made, PRODUCT, name, truth)
            if scenario.terms.get("B") and name == "K":
                continue  # too weak for this record: there to be a nuisance
            what, limit = f"rms error of {name}", LIMITS[name]
            bound = f"≤ {limit} %" if name == "N" else f"≤ {limit} × Cramér–Rao"
            if not len(given):
                yield what, bound, scenario.label, "never given", False
            elif name == "N":
                found = 100 * _rms(given)
                yield what, bound, scenario.label, f"{found:.3g} %", found <= limit
            else:
                ratio = _rms(given) / _bound(scenario)[name]
                yield what, bound, scenario.label, f"{ratio:.2f} ×", ratio <= limit
    white, limit = outcomes[WHITE], LIMITS["false"]
    false, number = _false(white, PRODUCT, "K"), len(white)
    bound, found = f"≤ {limit:.0%}", share(false, number)
    yield "K from white noise", bound, WHITE.label, found, false <= limit * number
