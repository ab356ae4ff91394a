"""The figures as a document."""

import platform

import numpy as np
import scipy

from bench.noise import accuracy, coverage, curve, detection, published, speed
from bench.study.tables import table

ACCURACY = """
Records of 3 h at 10 Hz, made by `imuloop.simulate.noise`; every estimator reads the same ones.
Relative rms error over the records in which the estimator gives the coefficient, and over all with
0 where it gives none. With {seeds} records an rms error is itself known to {own:.0%}. The bound is
that of the exact Gaussian likelihood, from dense covariances (`bench/noise/bound.py`). The rivals
(`bench/noise/rivals.py`) read the curve at log-spaced τ up to a third of the record."""
COVERAGE = """
Records of {length:,.0f} s at 10 Hz, {seeds} of each scenario; in brackets the 95 % interval of the
share after Clopper and Pearson. A true coverage of 95 % is by chance found outside 92 to 98 % with
a probability of {chance:.0%}. Bounds are checked where a term is identifiable in at least half of
the records."""
CURVE = """
Intervals of `allan.parquet`, whose degrees of freedom come from the fitted model, against the Allan
variance of the simulated discrete processes themselves. In brackets how many intervals; those of
one record and of neighbouring τ go together, so that their number says too much."""
DETECTION = """
Records of {length:,.0f} s at 10 Hz, each with one hump or line of {limits:g} detection limits,
{seeds} of each. A limit is the size that is found with 90 %: of a line by
`imuloop.noise.lines.detection_limit`, of a Gauss–Markov process by the expected gain of likelihood
over the nearest sum of Q, N, B and K. Named: that kind and no other, its frequency within 1/T, its
correlation time within a factor of {factor:g}."""
SPEED = """
From `samples.parquet` to `noise.json` by the workflow's own stage, imports included,
in a process of its own; the middle of the log is disturbed for {disturbed:g} s."""
# of a check that was met, not met, not decided
MET = {True: "yes", False: "**no**", None: "too few"}


def document(outcomes, command, commit, seeds):
    """Return docs/noise_figures.md.

    Parameters
    ----------
    outcomes : dict of str to object
        What each part's `run` gave, those that were run.
    command, commit : str
        What made them.
    seeds : int
        Records of each scenario of the accuracy; of the others as the tables say.
    """
    head = (
        f"Written by `{command}`, never by hand: commit {commit}, "
        f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}. "
        "How the estimator works: [noise.md](noise.md)."
    )
    parts = [("# Figures of the noise estimator", head)]
    rows = [
        (what, bound, found, MET[None if met is None else bool(met)])
        for name, outcome in outcomes.items()
        for what, bound, found, met in _checks(name, outcome)
    ]
    parts.append(("## Against the bounds", table(("what", "bound", "found", "met"), rows)))
    parts += [_section(name, outcome, seeds) for name, outcome in outcomes.items()]
    return "\n\n".join(f"{title}\n\n{text}" for title, text in parts) + "\n"


def _checks(name, outcome):
    if name in ("accuracy", "curve"):
        return PARTS[name].checks(*outcome)
    return PARTS[name].checks(outcome)


def _section(name, outcome, seeds):
    if name == "accuracy":
        intro = ACCURACY.format(seeds=seeds, own=1 / np.sqrt(2 * seeds))
        return "## Errors beside the bound and beside common tools", _with(
            intro, accuracy.text(*outcome)
        )
    if name == "coverage":
        many = len(next(iter(outcome.values())))
        intro = COVERAGE.format(
            seeds=many, chance=coverage.chance(many), length=coverage.LENGTH / coverage.RATE
        )
        return "## Coverage of the intervals", _with(intro, coverage.text(outcome))
    if name == "curve":
        return "## Coverage of the points of the Allan curve", _with(CURVE, curve.text(*outcome))
    if name == "detection":
        intro = DETECTION.format(
            length=detection.LENGTH / detection.RATE,
            limits=detection.LIMITS,
            seeds=len(next(iter(outcome.values()))),
            factor=detection.FACTOR,
        )
        return "## Humps and lines", _with(intro, detection.text(outcome))
    if name == "published":
        return "## Printed Allan deviations", published.text(outcome)
    intro = SPEED.format(disturbed=speed.DISTURBED)
    return "## Speed", _with(intro, speed.text(outcome))


def _with(intro, tables):
    return " ".join(intro.split()) + "\n\n" + tables


PARTS = {
    "accuracy": accuracy,
    "coverage": coverage,
    "curve": curve,
    "detection": detection,
    "published": published,
    "speed": speed,
}
