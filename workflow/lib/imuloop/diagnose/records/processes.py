"""Noise with a correlation time that the noise stage found: what it predicts of the next mean."""

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.core.samples import SENSORS
from imuloop.diagnose.choice import ratio_interval
from imuloop.diagnose.records.slow_noise import prediction_errors
from imuloop.diagnose.records.static import covering_part
from imuloop.diagnose.residuals import size
from imuloop.effects.drifts import GaussMarkov


def process_entry(sensor, problem, effects, fine, noise, curve_fit):
    """Return the entry of ``effects`` of a sensor's processes, None where they are none, and why.

    On the axes where they lower the error of the next mean, each part in time from its own
    beginning on. Takes the StaticProblem, the FittedEffects that are taken out, the StaticRecords
    of means over the shortest windows, the NoiseModel of what is left, and its plain fits.
    """
    errors, intervals, settings = {}, {}, problem.settings
    for place, axis in enumerate(SENSORS[sensor]):
        own, parts = noise.axes[axis], []
        if not own.gauss_markov:
            continue
        plain = {term: Coefficient(curve_fit[axis][term]) for term in "QNBK"}
        models = (AxisNoise(**plain, sinusoid=own.sinusoid), own)
        for record in fine:
            taken = sum((record.derivative(e.effect) @ e.vector for e in effects), 0.0)
            values, part_of_mean = (record.values - taken)[:, place], covering_part(record, problem)
            for part in set(part_of_mean.tolist()) - {-1}:
                at = part_of_mean == part
                predicted = [prediction_errors(values[at], record.windows[at], m) for m in models]
                parts.append((part_of_mean[at], *predicted))
        if parts:
            part_of_mean, *errors[axis] = map(np.concatenate, zip(*parts, strict=True))
            pair = (e[:, None] for e in errors[axis])
            intervals[axis] = ratio_interval(part_of_mean, *pair, settings)
    axes = [axis for axis, ends in intervals.items() if ends[1] < 1]
    if not intervals:
        return None, "the noise stage finds none"
    if not axes:
        low, high = min(intervals.values(), key=lambda ends: ends[1])
        why = f"the noise has it, but it predicts no mean better: ratio {low:.3f} to {high:.3f}"
        return None, why
    largest = {
        a: max(noise.axes[a].gauss_markov, key=lambda p: p.q.square * p.tc.value) for a in axes
    }
    terms = {f"{key}{a[1]}": getattr(largest[a], key) for key in ("q", "tc") for a in axes}
    ends = {name: c.ci95 or (c.value, c.value) for name, c in terms.items()}
    units = GaussMarkov().units(sensor)
    before, after = (np.column_stack(e) for e in zip(*(errors[a] for a in axes), strict=True))
    entry = {
        "name": GaussMarkov.name,
        "constants": {},
        "parameters": {name: c.value for name, c in terms.items()},
        "std": {name: (high - low) / 3.92 for name, (low, high) in ends.items()},
        "units": {name: units[name] for name in terms},
        # the noise stage has its own test
        "p_value": None,
        "residual": "bias",
        "axis": axes[0] if len(axes) == 1 else None,
        "heldout_before": size(before),
        "heldout_after": size(after),
        "ratio_ci95": ratio_interval(part_of_mean, before, after, settings),
    }
    return entry, "found by the noise stage; it predicts the next mean better"
