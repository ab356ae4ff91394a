"""Gaps in the samples: steps of time in which samples are lost. There are three kinds.

A *gap* is longer than `GAP_STEPS` usual steps, the median ones: a sample or more is lost in it.
Ingest counts these, and turns, windows and slow channels are corrected for them or leave them out.

A *long gap* is longer than `LONG_GAP_STEPS` usual steps: what lies before and after it does not
belong together. It is a segment of kind ``gap``, and so ends a rest and a turn.

A segment of kind ``gap`` may also be a stretch in which a channel is stuck (`core.segments`). One
that is longer than all segments of other kinds in its session together ends a *power cycle*
(`core.segments.power_cycles`).
"""

import numpy as np

# one sample lost makes a step two usual ones
GAP_STEPS = 1.5
# a clock that starts again goes on `ingest.clocks.RESET_STEPS`, ten, after its last stamp
LONG_GAP_STEPS = 9.5


def gap_limit(usual, steps=GAP_STEPS):
    """Return the longest step of time that is no gap, in the unit of the usual step."""
    return steps * usual


def lost_samples(steps, usual):
    """Return how many samples each step of time lost, ints, shape (n,): zero but in gaps.

    Takes steps, shape (n,), and the usual step, both in s.
    """
    wide = steps > gap_limit(usual)
    return np.where(wide, np.rint(steps / usual), 1).astype(int) - 1
