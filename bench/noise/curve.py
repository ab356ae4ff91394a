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
    """Return tau in s, and for each scenario whether intervals hold the truth, (seeds, points)."""
    made = by_scenario(_one, SCENARIOS, seeds, each, length)
    return curve_of(length, RATE)[0] / RATE, {s: np.array(held) for s, held in made.items()}


def _one(job):
    scenario, seed, length = job
    x, (factors, spread) = record(scenario, length, RATE, seed), curve_of(length, RATE)
    tau = factors / RATE
    edf = spread.degrees_of_freedom(estimate(x, RATE), tau)
    points = allan_table("ax", tau, allan_variance([x], factors), edf)
    truth = np.sqrt(expected(scenario, factors, length, RATE))
    return (points["ci_low"] <= truth) & (truth <= points["ci_high"])


def text(outcomes):
    """Return the introduction and the table, a row a half decade of averaging times."""
    tau, held = outcomes
    group = np.floor(2 * np.log10(tau) + 1e-9)
    places = [np.flatnonzero(group == g) for g in np.unique(group)]
    ends = [(f"{tau[here][0]:.4g}", f"{tau[here][-1]:.4g}") for here in places]
    names = ["–".join(dict.fromkeys(each)) for each in ends]
    rows = []
    for name, here in zip([*names, "all"], [*places, slice(None)], strict=True):
        rows.append([name, *(f"{each[:, here].mean():.1%}" for each in held.values())])
    header = ("τ, s", *(scenario.label for scenario in held))
    seeds = len(next(iter(held.values())))
    return f"{' '.join(INTRODUCTION.format(seeds=seeds).split())}\n\n{table(header, rows)}"


def checks(outcomes):
    """Yield what is required, its bound, of which case, what was found and whether it is met."""
    for scenario, inside in outcomes[1].items():
        met = within(inside.mean(), len(inside))
        yield "intervals of Allan points", "92–98 %", scenario.label, f"{inside.mean():.1%}", met
