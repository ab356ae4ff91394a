"""How often the intervals hold the truth: of coefficients and of limits."""

import numpy as np
from scipy.stats import binom

from bench.noise.records import RATE, TERMS, Scenario, by_scenario, estimate, record
from bench.study.tables import share, table

TITLE = "Coverage of the intervals"
INTRODUCTION = """
Records of {length:,.0f} s at 10 Hz, {seeds} of each kind. By chance a true coverage of 95 % is
found outside 92 to 98 % with a probability of {chance:.0%}. The bound is for terms that are
identifiable in half of the records or more. q and tc are of a Gauss–Markov process."""
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


def _coefficients(scenario, noise):
    """Yield name, truth and Coefficient of what the scenario holds; None where not found.

    A hump or a line stands for the injected one if it is the only one of its kind.
    """
    for name in TERMS:
        if name in scenario.terms:
            yield name, scenario.terms[name], getattr(noise, name)
    for truth, found, names in (
        (scenario.gauss_markov, noise.gauss_markov, ("q", "tc")),
        (scenario.sinusoid, noise.sinusoid, ("amplitude", "frequency")),
    ):
        for pair in truth:
            for name, value in zip(names, pair, strict=True):
                yield name, value, getattr(found[0], name) if len(found) == 1 else None


def _counts(scenario, made):
    """Return for each coefficient its truth and counts of records, as the table's columns."""
    total = {}
    for noise in made:
        for name, truth, c in _coefficients(scenario, noise):
            row = total.setdefault(name, [truth, 0, 0, 0, 0, 0])
            if c is None:
                continue
            holds = c.upper95 is not None and c.upper95 >= truth
            if c.identifiable:
                row[1] += 1
                row[2] += c.ci95[0] <= truth <= c.ci95[1]
            else:
                row[3] += 1
                row[4] += holds
            row[5] += holds
    return total


def _content(counts):
    """Return the coefficients that the records of a scenario hold, as text."""
    return ", ".join(f"{name} = {truth:g}" for name, (truth, *_) in counts.items())


def text(outcomes):
    """Return the introduction and the table, a row per kind of record, in it its coefficients."""
    rows, seeds = [], len(outcomes[SCENARIOS[0]])
    for scenario, made in outcomes.items():
        counted, cells = _counts(scenario, made), ([], [], [])
        for _, given, inside, limits, hold, always in counted.values():
            counts = ((inside, given), (hold, limits), (always, given + limits))
            for cell, (part, whole) in zip(cells, counts, strict=True):
                cell.append(f"{part}/{whole}" if whole else "–")
        rows.append((_content(counted), *map(", ".join, cells)))
    header = (
        "records", "identifiable: interval holds it",
        "not identifiable: upper limit holds it", "upper limit, all",
    )  # fmt: skip
    count = np.arange(np.ceil(LOW * seeds - 1e-9), np.floor(HIGH * seeds + 1e-9) + 1)
    chance = 1 - binom.pmf(count, seeds, 0.95).sum()
    introduction = INTRODUCTION.format(seeds=seeds, chance=chance, length=LENGTH / RATE)
    return f"{' '.join(introduction.split())}\n\n{table(header, rows)}"


def checks(outcomes):
    """Yield what is required, its bound, of which case, what was found and whether it is met."""
    what, bound = "95 % intervals of coefficients hold the truth", "92–98 %"
    for scenario, made in outcomes.items():
        counted = _counts(scenario, made)
        for name, (_, given, inside, *_) in counted.items():
            if given >= MOSTLY * len(made):
                case, met = f"{name} where {_content(counted)}", within(inside / given, given)
                yield what, bound, case, share(inside, given), met


def within(coverage, count):
    """Return whether a coverage found in `count` records is in its bounds, None for too few."""
    return LOW <= coverage <= HIGH if count >= FEW else None
