"""Errors of N, B and K beside the Cramér–Rao bound and common tools, all on the same records."""

import numpy as np

from bench.noise.bound import relative_bound
from bench.noise.product import curve, estimate, values
from bench.noise.records import RATE, Scenario, record
from bench.noise.rivals import RIVALS
from bench.study.tables import share, table
from imuloop.noise.allan import allan_variance

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
    """Return the estimates of every scenario.

    Parameters
    ----------
    seeds : int
        Records of each.
    each : callable
        ``map`` of several processes.
    length : int
        Samples of a record.

    Returns
    -------
    dict of Scenario to list of dict
        Of each record the coefficients by estimator and letter, and the processes that the
        product names beside them, ``"others"``.
    """
    jobs = [(scenario, seed, length) for scenario in SCENARIOS for seed in range(seeds)]
    made = list(each(one, jobs))
    return {s: [m for job, m in zip(jobs, made, strict=True) if job[0] is s] for s in SCENARIOS}


def one(job):
    """Return the estimates of one record."""
    scenario, seed, length = job
    x = record(scenario, length, RATE, seed)
    noise = estimate(x, RATE)
    factors, _ = curve(length, RATE)
    variance = allan_variance([x], factors)
    found = {PRODUCT: values(noise)}
    found.update({name: tool(factors / RATE, variance) for name, tool in RIVALS.items()})
    return {**found, "others": len(noise.gauss_markov) + len(noise.sinusoid)}


def bounds(length=LENGTH):
    """Return the Cramér-Rao bounds of every scenario by letter, 1."""
    return {s: relative_bound(s, length, RATE, unknown) for s, unknown in SCENARIOS.items()}


def rms(errors):
    """Return the root mean square, not-a-number of nothing."""
    return float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else np.nan


def errors(made, estimator, name, truth):
    """Return relative errors of one coefficient: where given, and of all with 0 where not."""
    found = [m[estimator].get(name) for m in made]
    given = [v / truth - 1 for v in found if v is not None]
    return np.array(given), np.array([(v or 0.0) / truth - 1 for v in found])


def text(outcomes, bound):
    """Return the tables, one a scenario and one of false terms."""
    parts = []
    for scenario, made in outcomes.items():
        names = list(scenario.terms)
        head = ["estimator"]
        for name in names:
            head += [f"{name}: rms error, %", "given", "all, 0 if not given"]
        rows = [_row(estimator, made, scenario.terms) for estimator in (PRODUCT, *RIVALS)]
        least = [text for n in names for text in (f"{100 * bound[scenario][n]:.3g}", "", "")]
        rows.append(["**Cramér–Rao bound**", *least])
        unknown = ", ".join((*SCENARIOS[scenario], "level"))
        truth = ", ".join(f"{name} = {value:g}" for name, value in scenario.terms.items())
        title = f"{scenario.label[0].upper()}{scenario.label[1:]}: {truth}; {len(made)} records. "
        parts.append(f"{title}The bound takes as unknown: {unknown}.\n\n{table(head, rows)}")
    white = outcomes[WHITE]
    rows = [
        [estimator, *(share(_false(white, estimator, n), len(white)) for n in "QBKR")]
        for estimator in (PRODUCT, *RIVALS)
    ]
    parts.append("Terms that are not there, given for white noise:\n\n" + table(_FALSE, rows))
    other = sum(m["others"] > 0 for m in white)
    parts.append(f"Humps and lines in white noise, imuloop: {share(other, len(white))}.")
    return "\n\n".join(parts)


_FALSE = ("estimator", "Q", "B", "K", "R")


def _row(estimator, made, truth):
    row = [estimator]
    for name, value in truth.items():
        given, every = errors(made, estimator, name, value)
        count = f"{len(given)} of {len(made)}"
        row += [_percent(given), count, _percent(every)] if len(given) else ["–", "0", "–"]
    return row


def _percent(errors):
    return f"{100 * rms(errors):.3g}"


def _false(made, estimator, name):
    return sum(m[estimator].get(name, 0) > 0 for m in made)


def checks(outcomes, bound):
    """Yield what is required, its bound, what was found and whether it is met."""
    for scenario, made in outcomes.items():
        for name, truth in scenario.terms.items():
            given, _ = errors(made, PRODUCT, name, truth)
            if scenario.terms.get("B") and name == "K":
                continue  # too weak for this record: there to be a nuisance
            what = f"{name}, rms error, {scenario.label}"
            if not len(given):
                yield what, "identifiable", f"0 of {len(made)}", False
            elif name == "N":
                found = 100 * rms(given)
                yield what, f"≤ {LIMITS['N']} %", f"{found:.3g} %", found <= LIMITS["N"]
            else:
                ratio = rms(given) / bound[scenario][name]
                seen = f"{ratio:.2f} × ({len(given)} of {len(made)} identifiable)"
                yield what, f"≤ {LIMITS[name]} × the bound", seen, ratio <= LIMITS[name]
    white = outcomes[WHITE]
    false = _false(white, PRODUCT, "K")
    yield (
        "K from white noise", f"≤ {LIMITS['false']:.0%}", share(false, len(white)),
        false <= LIMITS["false"] * len(white),
    )  # fmt: skip
