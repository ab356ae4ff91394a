"""Humps and lines of three detection limits: found and named? And where there are none?"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, nnls
from scipy.stats import norm

from bench.noise.product import SETTINGS, estimate
from bench.noise.records import RATE, Scenario, record
from bench.study.tables import share, table
from imuloop.noise.layout import Layout
from imuloop.noise.lines import detection_limit
from imuloop.noise.processes import densities, gauss_markov_density

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

    @property
    def label(self):
        if self.kind == "line":
            return f"line of {self.place:g} Hz in {self.noise}"
        return f"Gauss–Markov of {self.place:g} s in {self.noise}"


CASES = (
    Case("Gauss–Markov", 3.0, "white"),
    Case("Gauss–Markov", 20.0, "white"),
    Case("Gauss–Markov", 100.0, "white"),
    Case("Gauss–Markov", 20.0, "white and flicker"),
    Case("line", 0.08, "white"),
    Case("line", 1.3, "white"),
    Case("line", 0.08, "white and flicker"),
)


def limit(case, length=LENGTH, rate=RATE):
    """Return the q or the amplitude that is found with 90 %, SI."""
    terms = NOISE[case.noise]
    theta = np.array([terms.get(name, 0.0) ** 2 for name in "QNBK"])
    if case.kind == "line":
        layout = Layout(rate, (0,), (length,), (0,))
        return detection_limit(
            [layout],
            lambda f: 2 * densities(f, 1 / rate) @ theta,
            case.place,
            SETTINGS.hump_significance,
            PROBABILITY,
        )
    return gauss_markov_limit(theta, case.place, length, rate)


def gauss_markov_limit(theta, tc, length, rate, level=SETTINGS.hump_significance):
    r"""Return the density q of a Gauss-Markov process that is found with 90 %.

    The likelihood gains what the spectrum s with the process has over the nearest one s' that Q,
    N, B and K can make without it,

    .. math:: g = \tfrac12 \sum_k (s_k/s'_k - 1 - \ln s_k/s'_k), \quad f_k = k/2T

    and the process is found with probability P at the level a where
    :math:`\sqrt{2 g} = z_{1 - a} + z_P`.
    """
    k = np.unique(np.rint(np.geomspace(1, length - 1, 600)))
    count = np.gradient(k)
    f = k * rate / (2 * length)
    units = densities(f, 1 / rate)
    shape = gauss_markov_density(f, 1 / rate, tc) * tc / 2
    aim = norm.isf(level / TIMES) + norm.ppf(PROBABILITY)

    def excess(log_q):
        there = units @ theta + np.exp(2 * log_q) * shape
        without = there
        for _ in range(30):
            weight = np.sqrt(count) / without
            a = units * weight[:, None]
            size = np.linalg.norm(a, axis=0)
            without = units @ (nnls(a / size, there * weight)[0] / size)
        ratio = there / without
        return np.sqrt(max(count @ (ratio - 1 - np.log(ratio)), 0)) - aim

    return float(np.exp(brentq(excess, np.log(1e-8), np.log(1e2), xtol=1e-3)))


def run(seeds, each, length=LENGTH, cases=CASES, controls=CONTROLS):
    """Return for each Scenario whether each record was named, and the humps and lines found."""
    jobs = []
    for case in cases:
        scenario = injected(case, length)
        jobs += [(case, scenario, seed, length) for seed in range(seeds)]
    jobs += [(None, control, seed, length) for control in controls for seed in range(2 * seeds)]
    results = list(each(one, jobs))
    outcomes = {}
    for (_, scenario, *_), result in zip(jobs, results, strict=True):
        outcomes.setdefault(scenario, []).append(result)
    return outcomes


def injected(case, length=LENGTH):
    """Return the Scenario of a case at `LIMITS` detection limits."""
    size = LIMITS * limit(case, length)
    plain = Scenario(case.label, NOISE[case.noise])
    if case.kind == "line":
        return replace(plain, sinusoid=((size, case.place),))
    return replace(plain, gauss_markov=((size, case.place),))


def one(job):
    """Return whether the case was found and named, and all humps and lines that were."""
    case, scenario, seed, length = job
    noise = estimate(record(scenario, length, RATE, seed), RATE)
    named = [("Gauss–Markov", p.tc.value) for p in noise.gauss_markov]
    named += [("line", p.frequency.value) for p in noise.sinusoid]
    return case is not None and is_named(case, named, length), named


def is_named(case, named, length):
    """Return whether what was found has the right kind and place, and nothing is beside it."""
    if [kind for kind, _ in named] != [case.kind]:
        return False
    place = named[0][1]
    if case.kind == "line":
        return abs(place - case.place) <= RATE / length
    return 1 / FACTOR <= place / case.place <= FACTOR


def text(outcomes):
    """Return the tables of the cases and of the controls."""
    rows, plain = [], []
    for scenario, results in outcomes.items():
        kinds = [{kind for kind, _ in named} for _, named in results]
        humps, lines = (sum(k in each for each in kinds) for k in ("Gauss–Markov", "line"))
        if scenario in CONTROLS:
            alarms = share(sum(map(bool, kinds)), len(kinds))
            plain.append((scenario.label, alarms, humps, lines))
        else:
            size = (scenario.gauss_markov or scenario.sinusoid)[0][0]
            right = share(sum(right for right, _ in results), len(results))
            rows.append((scenario.label, f"{size:.3g}", right, humps, lines))
    header = ("injected", "q or amplitude, SI", "found and named", "with a hump", "with a line")
    controls = ("no hump, no line", "with any", "humps", "lines")
    return f"{table(header, rows)}\n\n{table(controls, plain)}"


def checks(outcomes):
    """Yield what is required, its bound, what was found and whether it is met."""
    for scenario, results in outcomes.items():
        if scenario in CONTROLS:
            alarms = sum(bool(named) for _, named in results)
            good = alarms <= ALARMS * len(results)
            yield (
                f"{scenario.label}: any hump or line",
                f"≤ {ALARMS:.0%}",
                share(alarms, len(results)),
                good,
            )
        else:
            right = sum(right for right, _ in results)
            good = right >= FOUND * len(results)
            yield f"{scenario.label}, named", f"≥ {FOUND:.0%}", share(right, len(results)), good
