"""Stretches: ranges of samples against masks."""

from itertools import pairwise

import numpy as np
import pandas as pd
from hypothesis import given
from hypothesis import strategies as st

from imuloop.core.samples import Samples
from imuloop.core.stretches import merged, stretches_of, unbroken, without


def test_stretches_of_a_mask_and_between_long_gaps():
    assert stretches_of([1, 1, 0, 1]).tolist() == [[0, 2], [3, 4]]
    assert stretches_of([0, 0]).tolist() == [] and stretches_of([1]).tolist() == [[0, 1]]
    stretches, step = unbroken(Samples(pd.DataFrame({"t": [0.0, 1.0, 2.0, 4.0, 5.0, 6.4]})), 1.5)
    assert stretches.tolist() == [[0, 3], [3, 6]]
    assert step == 1.0
    assert unbroken(Samples(pd.DataFrame({"t": []})), 1.5)[0].shape == (0, 2)


@given(
    st.lists(st.tuples(st.integers(0, 60), st.integers(1, 9)), min_size=1, max_size=12), st.data()
)
def test_cuts_leave_what_a_mask_leaves(cuts, data):
    edges = sorted(data.draw(st.sets(st.integers(0, 60), min_size=2, max_size=8)))
    ranges = np.array(list(pairwise(edges))[::2])
    cuts = merged(np.array([(i, i + n) for i, n in cuts], dtype=int).reshape(-1, 2))
    assert np.all(cuts[1:, 0] > cuts[:-1, 1])
    left = []
    for i, j in ranges:
        mask = np.ones(j - i, dtype=bool)
        for first, last in cuts:
            mask[max(first - i, 0) : max(last - i, 0)] = False
        left += (stretches_of(mask) + i).tolist()
    assert without(ranges, cuts).tolist() == left
