"""Humps and lines of three detection limits: found and named? And where there are none?"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq
from scipy.special import betaincinv, chndtrinc, ndtri

from bench.noise.records import RATE, SETTINGS, Scenario, by_scenario, estimate, record
from bench.study.tables import share, table
from imuloop.noise.likelihood import weighted_nnls
from imuloop.noise.periodogram import Periodogram, chance_at_one, chance_over_band
from imuloop.noise.processes import densities, gauss_markov_density
from imuloop.noise.sampling import Sampling

TITLE = "Humps and lines"
INTRODUCTION = """
Records of {length:,.0f} s at 10 Hz, each with one hump or line of {limits:g} detection limits, of
which one is found with 90 % (`bench/noise/detection.py`). Named: that kind and no other, its
frequency within 1/T, its correlation time within a factor of {factor:g}. Controls without any:
{controls}."""
# 10,000 s
LENGTH = 100_000
LIMITS = 3.0
# of the requirement
FOUND, ALARMS = 0.90, 0.05
# chance of finding what lies at one limit
PROBABILITY = 0.9
# correlation times that count as tried independently of each other
TIMES = 10
# named: correlation time within this factor, frequency within one over the record
FACTOR = 2.0
# chance of a hump or line in noise that has none
LEVEL = SETTINGS.significance

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
    """A hump or line in a noise: `kind` with its correlation time in s or frequency in Hz."""

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


def line_limit(sampling, density, frequency, level=LEVEL):
    r"""Return the amplitude of a line that is found with 90 %.

    Twice I/S is non-central chi-square with two degrees of freedom and
    :math:`\lambda = A^2 n/(r S)`; `density` is S, one-sided, as a function of frequency in Hz.
    """
    n, rng = sampling.lengths.sum(), np.random.default_rng(0)
    noise = Periodogram.of(sampling.with_values(rng.standard_normal(n)), density)
    sizes = noise.sizes[noise.near(frequency)]
    m, sides = sizes.min(), len(sizes)
    ratio = brentq(
        lambda x: chance_over_band(chance_at_one(x, m, sides), noise.independent) - level, 0.1, 1e6
    )
    half = (m + 1) / 2
    # the line itself, some three values wide, lies in the block that it is compared with
    share = betaincinv(half, half, 0.5 ** (1 / sides)) * m / (m - 3)
    noncentrality = chndtrinc(-2 * ratio * np.log1p(-share), 2, 1 - PROBABILITY)
    return np.sqrt(noncentrality * noise.rate * density(np.array([frequency]))[0] / n)


def gauss_markov_limit(theta, tc, length, rate, level=LEVEL):
    r"""Return the density q of a Gauss-Markov process that is found with 90 %.

    The likelihood gains what the spectrum s with the process has over the nearest one s' that Q,
    N, B and K can make without it, :math:`g = \tfrac12 \sum_k (s_k/s'_k - 1 - \ln s_k/s'_k)` at
    :math:`f_k = k/2T`, and the process is found with probability P at the level a where
    :math:`\sqrt{2 g} = z_{1 - a} + z_P`.
    """
    k = np.unique(np.rint(np.geomspace(1, length - 1, 600)))
    count, f = np.gradient(k), k * rate / (2 * length)
    units = densities(f, 1 / rate)
    shape = gauss_markov_density(f, 1 / rate, tc) * tc / 2
    aim = ndtri(PROBABILITY) - ndtri(level / TIMES)

    def excess(log_q):
        there = without = units @ theta + np.exp(2 * log_q) * shape
        for _ in range(30):
            without = units @ weighted_nnls(units, there, count / without**2)
        ratio = there / without
        return np.sqrt(max(count @ (ratio - 1 - np.log(ratio)), 0)) - aim

    return float(np.exp(brentq(excess, np.log(1e-8), np.log(1e2), xtol=1e-3)))


def run(seeds, each, length=LENGTH, cases=CASES, controls=CONTROLS):
    """Return for each Scenario whether each record was named, and the humps and lines found."""
    injected = {case.scenario(length): case for case in cases}
    made = by_scenario(_one, injected, seeds, each, length)
    made |= by_scenario(_one, controls, 2 * seeds, each, length)
    return {
        scenario: [
            (scenario in injected and injected[scenario].is_named(named, length), named)
            for named in found
        ]
        for scenario, found in made.items()
    }


def _one(job):
    """Return the kind and place of all humps and lines that were found."""
    scenario, seed, length = job
    noise = estimate(record(scenario, length, RATE, seed), RATE)
    named = [("Gauss–Markov", p.tc.value) for p in noise.gauss_markov]
    return named + [("line", p.frequency.value) for p in noise.sinusoid]


def text(outcomes):
    """Return the introduction and the table of the cases; of the controls the checks say all."""
    rows = []
    for scenario, results in outcomes.items():
        if scenario not in CONTROLS:
            size = (scenario.gauss_markov or scenario.sinusoid)[0][0]
            rows.append(
                (
                    scenario.label,
                    f"{size:.3g}",
                    f"{sum(right for right, _ in results)}/{len(results)}",
                )
            )
    controls = "; ".join(s.label for s in outcomes if s in CONTROLS)
    introduction = INTRODUCTION.format(
        length=LENGTH / RATE, limits=LIMITS, factor=FACTOR, controls=controls
    )
    cases = table(("injected", "q or amplitude, SI", "found and named"), rows)
    return f"{' '.join(introduction.split())}\n\n{cases}"


def checks(outcomes):
    """Yield what is required, its bound, of which case, what was found and whether it is met."""
    for scenario, results in outcomes.items():
        number, case = len(results), scenario.label
        if scenario in CONTROLS:
            alarms, bound = sum(bool(found) for _, found in results), f"≤ {ALARMS:.0%}"
            met = alarms <= ALARMS * number
            yield "false humps and lines", bound, case, share(alarms, number), met
        else:
            right, bound = sum(right for right, _ in results), f"≥ {FOUND:.0%}"
            met = right >= FOUND * number
            yield "humps and lines named", bound, case, share(right, number), met
