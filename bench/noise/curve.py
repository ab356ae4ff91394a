"""How often the interval of a point of the Allan curve holds the true Allan variance."""

import numpy as np

from bench.noise.bound import difference_covariance
from bench.noise.coverage import within
from bench.noise.product import curve, curve_table
from bench.noise.records import RATE, Scenario, record
from bench.study.tables import table

LENGTH = 100_000
SCENARIOS = (
    Scenario("white", {"N": 0.01}),
    Scenario("white and flicker", {"N": 0.01, "B": 4e-3}),
    Scenario("white and walk", {"N": 0.01, "K": 5e-4}),
)


def expected(scenario, factors, n, rate):
    """Return the Allan variance of the discrete processes themselves, SI squared.

    Half the variance of the difference of two means; not the formulas that are fitted, which
    hold for continuous time.
    """
    return sum(
        value**2 * np.array([difference_covariance(name, m, 1, n, rate)[0] for m in factors]) / 2
        for name, value in scenario.terms.items()
    )


def run(seeds, each, length=LENGTH):
    """Return tau in s, and for each scenario whether intervals hold the truth, (seeds, points)."""
    jobs = [(scenario, seed, length) for scenario in SCENARIOS for seed in range(seeds)]
    made = np.array(list(each(one, jobs))).reshape(len(SCENARIOS), seeds, -1)
    return curve(length, RATE)[0] / RATE, dict(zip(SCENARIOS, made, strict=True))


def one(job):
    """Return whether the interval of each point holds the truth."""
    scenario, seed, length = job
    points = curve_table(record(scenario, length, RATE, seed), RATE)
    truth = np.sqrt(expected(scenario, curve(length, RATE)[0], length, RATE))
    return (points["ci_low"] <= truth) & (truth <= points["ci_high"])


def text(tau, outcomes):
    """Return the table, a row a half decade of averaging times."""
    group = np.floor(2 * np.log10(tau) + 1e-9)
    rows = []
    for g in np.unique(group):
        here = group == g
        span = f"{tau[here][0]:.3g} to {tau[here][-1]:.3g}"
        held = (inside[:, here] for inside in outcomes.values())
        rows.append([span, *(f"{h.mean():.1%} ({h.size})" for h in held)])
    for name, places in (("longest τ", slice(-1, None)), ("all", slice(None))):
        held = (inside[:, places] for inside in outcomes.values())
        rows.append([name, *(f"{h.mean():.1%} ({h.size})" for h in held)])
    return table(("τ, s", *(s.label for s in outcomes)), rows)


def checks(_, outcomes):
    """Yield what is required, its bound, what was found and whether it is met."""
    for scenario, inside in outcomes.items():
        single = inside.mean(axis=0)
        seen = f"{inside.mean():.1%}; single τ {single.min():.0%} to {single.max():.0%}"
        what = f"coverage of the Allan points, {scenario.label}"
        yield what, "92–98 %", seen, within(inside.mean(), len(inside))
