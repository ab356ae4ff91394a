"""Gaps: time steps in which samples are missing. There are three kinds.

A *gap* is longer than `GAP_STEPS` usual steps; the usual step is the median. At least one sample is
missing in it. Ingest counts gaps. Integrals of the rate, means over windows and channels with a
lower sampling rate are corrected for gaps, or leave them out.

A *long gap* is longer than `LONG_GAP_STEPS` usual steps. It is a segment of kind ``gap``, and so
ends a rest or a motion.

A segment of kind ``gap`` may also be a stretch in which a channel is stuck (`core.segments`). If a
segment of kind ``gap`` is longer than all segments of other kinds of its session together, it ends
a *power cycle* (`core.segments.power_cycles`).
"""

import numpy as np

# one dropped sample doubles the step
GAP_STEPS = 1.5
# less than `ingest.clocks.FEW_STEPS`, ten: the step that ingest puts where a clock starts again
LONG_GAP_STEPS = 9.5


def gap_limit(usual, steps=GAP_STEPS):
    """Return the longest time step that is not a gap, in the unit of `usual`.

    A gap is a step in which samples are missing. `usual` is the usual step, and `steps` is the
    limit as a number of usual steps, by default `GAP_STEPS`.
    """
    return steps * usual


def lost_samples(steps, usual):
    """Return the number of samples that are missing in each of n time steps, (n,) of int.

    `steps`, (n,), are the time steps, s, and `usual` is the usual step, s. The number is 0 in a
    step of at most `GAP_STEPS` usual steps.
    """
    is_gap = steps > gap_limit(usual)
    return np.where(is_gap, np.rint(steps / usual), 1).astype(int) - 1
