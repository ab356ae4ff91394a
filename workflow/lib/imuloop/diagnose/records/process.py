"""Noise with a correlation time in static records: its test, its held-out likelihood, its limit."""

from dataclasses import dataclass

import numpy as np

from imuloop.diagnose.content import untried
from imuloop.diagnose.records.static import fold_of
from imuloop.diagnose.residuals import size
from imuloop.effects.gauss_markov import GaussMarkov
from imuloop.noise.coloured import (
    Coloured,
    WindowSpectrum,
    coefficients,
    coloured,
    held_out_ratio,
    limits,
)

# means without a gap between them that a spectrum needs
LEAST_IN_SPECTRUM = 16


@dataclass(frozen=True)
class Process:
    """What the spectra say of noise with a correlation time."""

    test: Coloured
    spectrum: WindowSpectrum  # of the three axes, effects taken out
    window: float  # length of the windows of the spectrum, s
    share: float  # by how much it shrinks the error that held-out means are expected to have
    ratio: list  # 95 % interval of this share
    threshold: float  # logarithm of the largest p-value that passes

    @property
    def found(self):
        """Whether the noise is there: it passes its test, and held-out data are likelier."""
        return bool(self.test.log_p < self.threshold and self.ratio[1] < 1)


def find_process(fine, choices):
    """Return the Process of the means over the shortest windows, `fine`, beside what was chosen.

    None without enough in a row.
    """
    problem, derivatives = choices.problem, {}

    def left(out):
        """Return the coefficients of all runs, and of their parts in each block, effects out."""
        search, base = choices.search(out), choices.nested(out)
        training = search.training(base)
        each = [training.parameters(base, axis)[1] for axis in range(3)] if base else []
        whole, parts = [], [[] for _ in range(problem.parts)]
        for i, record in enumerate(fine):
            values = record.values.copy()
            for e in base:
                if (i, e) not in derivatives:
                    derivatives[i, e] = record.derivative(e)
                for axis, own in enumerate(each):
                    values[:, axis] -= derivatives[i, e][:, axis] @ own[e]
            fold = fold_of(record, problem)
            # a number for each run of windows that touch
            gap = np.diff(record.windows[:, 0], prepend=-np.inf) > 1.5 * record.length
            run = np.cumsum(gap | (np.diff(record.stretch, prepend=-1) != 0))
            for number in np.unique(run):
                rows = run == number
                if rows.sum() >= LEAST_IN_SPECTRUM:
                    whole.append(coefficients(values[rows]))
                for k in range(problem.parts):
                    if (rows & (fold == k)).sum() >= LEAST_IN_SPECTRUM:
                        parts[k].append(coefficients(values[rows & (fold == k)]))
        return whole, parts

    whole, parts = left(frozenset())
    if not whole or not all(parts):
        return None
    window, spectrum, pairs = float(np.median(fine[0].length)), WindowSpectrum.of(whole), []
    for k in range(problem.parts):
        # without an effect every part's search leaves the same
        if choices.choice().base:
            _, parts = left(frozenset({k}))
        others = [c for j, own in enumerate(parts) if j != k for c in own]
        pairs.append((others, parts[k]))
    share, ratio = held_out_ratio(pairs, problem.settings.draws, problem.settings.seed)
    threshold = choices.search().threshold(len(choices.choice().base))
    return Process(coloured(spectrum, window), spectrum, window, share, ratio, threshold)


def process_entry(sensor, process, after):
    """Return the entry of the process among the effects that were added.

    `after`, (n, 3), are the held-out errors with all other effects.
    """
    before, names = size(after), list(GaussMarkov.parameters)
    values, std = (dict(zip(names, v, strict=True)) for v in process.test.drive.tolist())
    return {
        "name": GaussMarkov.name,
        "constants": {"tc": process.test.tc},
        "parameters": values,
        "std": std,
        "units": GaussMarkov().units(sensor),
        "p_value": process.test.p_value,
        "residual": "bias",
        "axis": None,
        # the error itself does not fall: what is foreseen of it does
        "heldout_before": before,
        "heldout_after": process.share * before,
        "ratio_ci95": process.ratio,
    }


def process_candidate(sensor, process, after, power):
    """Return the entry of the process among the candidates; arguments as of `process_entry`."""
    name = GaussMarkov.name
    if process is None:
        return untried(name, "not_observable", "too few means without a gap for a spectrum")
    test, threshold = process.test, process.threshold
    tc, found = limits(test, process.spectrum, process.window, threshold, power)
    if process.found:
        status, tc = "added", test.tc
        why = (
            "the spectrum is likelier with it; held-out error is what is foreseen of it, by the "
            "predictive likelihood, for noise cannot be subtracted"
        )
    elif not any(found):
        why = "flicker and walk would imitate it in records as short as these"
        return untried(name, "not_observable", why)
    else:
        status, why = "rejected", "the spectrum is not likelier with it by more than chance"
        if test.log_p < threshold:
            low, high = process.ratio
            why = f"held-out blocks are not likelier for certain: ratio {low:.3f} to {high:.3f}"
    each = zip(GaussMarkov.parameters, found, strict=True)
    return {
        "name": name,
        "status": status,
        "why": why,
        "residual": "bias",
        "p_value": test.p_value,
        "heldout_after": process.share * size(after),
        "constants": {"tc": tc},
        "confounded_with": None,
        "detection_limit": {parameter: q for parameter, q in each if q is not None},
        "units": GaussMarkov().units(sensor),
    }
