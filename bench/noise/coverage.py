"""How often the intervals hold the truth: of coefficients and of limits."""

import numpy as np
from scipy.stats import binom

from bench.noise.records import RATE, TERMS, Scenario, by_scenario, estimate, record
from bench.tables import met, share, table

TITLE = "Coverage of the intervals"
INTRODUCTION = """Records of {length:,.0f} s at 10 Hz, {seeds} of each kind. Required: an interval \
of 95 % holds the truth in 92 to 98 %, of a term that is identifiable in half of the records or \
more; by chance a true coverage of 95 % is found outside with a probability of {chance:.0%}. q and \
tc are of a Gauss–Markov process."""
# 10,000 s
LENGTH = 100_000
SCENARIOS = (
    Scenario("N", {"N": 0.01}),
    Scenario("N, K = 1e-4", {"N": 0.01, "K": 1e-4}),
    Scenario("N, K = 3e-5", {"N": 0.01, "K": 3e-5}),
    Scenario("N, B = 2e-3, K = 1e-5", {"N": 0.01, "B": 2e-3, "K": 1e-5}),
    Scenario("Q, N", {"Q": 5e-3, "N": 0.01}),
    Scenario("strong Q, N", {"Q": 0.1, "N": 0.01}),
    Scenario("N, B, K strong", {"N": 0.01, "B": 5e-3, "K": 5e-4}),
    Scenario("N, weak R", {"N": 0.01, "R": 3.5e-7}),
    Scenario("N, R", {"N": 0.01, "R": 1e-6}),
    Scenario("N, Gauss–Markov", {"N": 0.01}, gauss_markov=((2e-3, 20.0),)),
    Scenario("N, line", {"N": 0.01}, sinusoid=((3e-3, 0.08),)),
)
LOW, HIGH = 0.92, 0.98
# a term counts as identifiable in a scenario where it is in this share of its records
MOSTLY = 0.5
# fewer intervals cannot tell whether the coverage is in its bounds
FEW = 100


def run(seeds, each, length=LENGTH):
    """Return the AxisNoise of every record of every scenario."""
    return by_scenario(_one, SCENARIOS, seeds, each, length)


def _one(job):
    scenario, seed, length = job
    return estimate(record(scenario, length, RATE, seed), RATE)


def coefficients(scenario, noise):
    """Return truth and Coefficient, by name, of what a scenario holds; None where not found.

    A process or a line stands for the injected one if it is the only one of its kind.
    """
    found = {n: (scenario.terms[n], getattr(noise, n)) for n in TERMS if n in scenario.terms}
    for kind, names in (("gauss_markov", ("q", "tc")), ("sinusoid", ("amplitude", "frequency"))):
        each = getattr(noise, kind)
        for truth in getattr(scenario, kind):
            for name, value in zip(names, truth, strict=True):
                found[name] = value, getattr(each[0], name) if len(each) == 1 else None
    return found


def text(outcomes):
    """Return the introduction and the table, a row per coefficient of each kind of record."""
    rows, seeds = [], len(outcomes[SCENARIOS[0]])
    for scenario, made in outcomes.items():
        every = [coefficients(scenario, noise) for noise in made]
        for name, (truth, _) in every[0].items():
            given = [each[name][1] for each in every if each[name][1] is not None]
            inside = [c.ci95[0] <= truth <= c.ci95[1] for c in given if c.identifiable]
            below = [c.upper95 is not None and truth <= c.upper95 for c in given]
            good = None
            if len(inside) >= max(MOSTLY * len(made), FEW):
                good = LOW <= np.mean(inside) <= HIGH
            shares = (share(sum(each), len(each)) for each in (inside, below))
            rows.append((scenario.label, f"{name} = {truth:g}", *shares, met(good)))
    count = np.arange(np.ceil(LOW * seeds - 1e-9), np.floor(HIGH * seeds + 1e-9) + 1)
    chance = 1 - binom.pmf(count, seeds, 0.95).sum()
    introduction = INTRODUCTION.format(seeds=seeds, chance=chance, length=LENGTH / RATE)
    head = ("records", "coefficient", "identifiable: interval holds it", "upper limit holds it")
    return f"{introduction}\n\n{table((*head, 'met'), rows)}"
