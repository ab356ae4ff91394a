"""How often the interval of a point of the Allan curve holds the true Allan variance."""

import numpy as np

from bench.noise.bound import difference_covariance
from bench.noise.coverage import within
from bench.noise.records import RATE, Scenario, by_scenario, curve_of, estimate, record
from bench.study.tables import table
from imuloop.noise.allan import allan_table, allan_variance

TITLE = "Coverage of the points of the Allan curve"
INTRODUCTION = """
Share of the 95 % intervals of `allan.parquet` that hold the Allan variance of the simulated
discrete processes, over {seeds} records of each kind. Those of one record go together."""
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
    """Return for each scenario whether intervals hold the truth, shape (seeds, points)."""
    made = by_scenario(_one, SCENARIOS, seeds, each, length)
    return {scenario: np.array(held) for scenario, held in made.items()}


def _one(job):
    scenario, seed, length = job
    x, (factors, spread) = record(scenario, length, RATE, seed), curve_of(length, RATE)
    tau = factors / RATE
    edf = spread.degrees_of_freedom(estimate(x, RATE), tau)
    points = allan_table("ax", tau, allan_variance([x], factors), edf)
    truth = np.sqrt(expected(scenario, factors, length, RATE))
    return (points["ci_low"] <= truth) & (truth <= points["ci_high"])


def text(outcomes):
    """Return the introduction and the table."""
    rows = []
    for scenario, inside in outcomes.items():
        single = inside.mean(axis=0)
        seen = f"{single.min():.0%} to {single.max():.0%}"
        rows.append((scenario.label, f"{inside.mean():.1%}", seen))
    seeds = len(next(iter(outcomes.values())))
    shares = table(("records", "all τ", "single τ"), rows)
    return f"{' '.join(INTRODUCTION.format(seeds=seeds).split())}\n\n{shares}"


def checks(outcomes):
    """Yield what is required, its bound, of which case, what was found and whether it is met."""
    for scenario, inside in outcomes.items():
        met = within(inside.mean(), len(inside))
        yield "intervals of Allan points", "92–98 %", scenario.label, f"{inside.mean():.1%}", met
