"""Gauss–Markov processes and lines of three detection limits: named? And where there are none?"""

from dataclasses import dataclass, replace

import numpy as np

from bench.noise.limits import gauss_markov_limit, line_limit
from bench.noise.records import RATE, Scenario, by_scenario, estimate, record
from bench.tables import met, share, table
from imuloop.noise.processes import densities
from imuloop.noise.sampling import Sampling

TITLE = "Gauss–Markov processes and lines"
INTRODUCTION = """Records of {length:,.0f} s at 10 Hz, each with one process or line of {limits:g} \
detection limits, of which one is found with 90 % (`bench/noise/limits.py`). Named: that kind and \
no other, its frequency within 1/T, its correlation time within a factor of {factor:g}. Required: \
≥ {found:.0%} named, ≤ {alarms:.0%} of the controls with any."""
# 10,000 s
LENGTH = 100_000
LIMITS = 3.0
# required
FOUND, ALARMS = 0.90, 0.05
# named: correlation time within this factor, frequency within one over the record
FACTOR = 2.0

NOISE = {"white": {"N": 0.01}, "white and flicker": {"N": 0.01, "B": 2e-3}}
SIGMA = 0.01 * np.sqrt(RATE)
CONTROLS = (
    Scenario("white", {"N": 0.01}),
    Scenario("white and flicker", {"N": 0.01, "B": 4e-3}),
    Scenario("white and walk", {"N": 0.01, "K": 3e-4}),
    Scenario("N, B, K", {"N": 0.01, "B": 4e-3, "K": 3e-4}),
    Scenario("white, rounded to σ/2", {"N": 0.01}, step=SIGMA / 2),
    Scenario("N, B, K, rounded to σ/2", {"N": 0.01, "B": 4e-3, "K": 3e-4}, step=SIGMA / 2),
)


@dataclass(frozen=True, eq=False)
class Case:
    """A process or line in a noise: `kind` with its correlation time in s or frequency in Hz."""

    kind: str
    place: float
    noise: str

    def scenario(self, length=LENGTH):
        """Return the Scenario of the case at `LIMITS` detection limits."""
        terms = NOISE[self.noise]
        theta = np.array([terms.get(name, 0.0) ** 2 for name in "QNBK"])
        if self.kind == "line":
            plain = Scenario(f"line of {self.place:g} Hz in {self.noise}", terms)
            sampling = Sampling.unbroken(RATE, length)
            limit = line_limit(sampling, lambda f: 2 * densities(f, 1 / RATE) @ theta, self.place)
            return replace(plain, sinusoid=((LIMITS * limit, self.place),))
        plain = Scenario(f"Gauss–Markov of {self.place:g} s in {self.noise}", terms)
        limit = gauss_markov_limit(theta, self.place, length, RATE)
        return replace(plain, gauss_markov=((LIMITS * limit, self.place),))

    def is_named(self, named, length):
        """Return whether what was found has the right kind and place, and nothing is beside it."""
        if [kind for kind, _ in named] != [self.kind]:
            return False
        place = named[0][1]
        if self.kind == "line":
            return abs(place - self.place) <= RATE / length
        return 1 / FACTOR <= place / self.place <= FACTOR


CASES = (
    Case("Gauss–Markov", 3.0, "white"),
    Case("Gauss–Markov", 20.0, "white"),
    Case("Gauss–Markov", 100.0, "white"),
    Case("Gauss–Markov", 20.0, "white and flicker"),
    Case("line", 0.08, "white"),
    Case("line", 1.3, "white"),
    Case("line", 0.08, "white and flicker"),
)


def run(seeds, each, length=LENGTH, cases=CASES, controls=CONTROLS):
    """Return for each Scenario whether each record was named, or has a false alarm."""
    injected = {case.scenario(length): case for case in cases}
    found = by_scenario(_one, injected, seeds, each, length)
    made = {s: [injected[s].is_named(named, length) for named in found[s]] for s in injected}
    plain = by_scenario(_one, controls, 2 * seeds, each, length)
    return made | {s: [bool(named) for named in each] for s, each in plain.items()}


def _one(job):
    """Return the kind and place of all processes and lines that were found."""
    scenario, seed, length = job
    noise = estimate(record(scenario, length, RATE, seed), RATE)
    named = [("Gauss–Markov", p.tc.value) for p in noise.gauss_markov]
    return named + [("line", p.frequency.value) for p in noise.sinusoid]


def text(outcomes):
    """Return the introduction and the table of the cases and controls."""
    rows = []
    for scenario, results in outcomes.items():
        count, number, size = sum(results), len(results), "–"
        good = count <= ALARMS * number
        if injected := scenario.gauss_markov or scenario.sinusoid:
            size, good = f"{injected[0][0]:.3g}", count >= FOUND * number
        rows.append((scenario.label, size, share(count, number), met(good)))
    introduction = INTRODUCTION.format(
        length=LENGTH / RATE, limits=LIMITS, factor=FACTOR, found=FOUND, alarms=ALARMS
    )
    head = ("records", "q or amplitude, SI", "named; of controls any", "met")
    return f"{introduction}\n\n{table(head, rows)}"
