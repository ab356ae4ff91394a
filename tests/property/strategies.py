"""What the properties hold for: devices of any errors and orientation."""

import itertools

import numpy as np
from hypothesis import strategies as st

G = 9.80665
seeds = st.integers(0, 2**32 - 1)


@st.composite
def misalignments(draw, triangular=False, size=0.05):
    """Matrices with a unit diagonal; upper triangular as for an accelerometer."""
    T = np.eye(3)
    for i, j in itertools.permutations(range(3), 2):
        if i < j or not triangular:
            T[i, j] = draw(st.floats(-size, size))
    return T


def vectors(low, high):
    return st.tuples(*[st.floats(low, high)] * 3).map(np.array)


# all ways to name and turn round three axes, mirrored ones too
signed_permutations = st.sampled_from(
    [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in itertools.permutations(range(3))
        for signs in itertools.product([1, -1], repeat=3)
    ]
)


def directions(n, seed):
    u = np.random.default_rng(seed).normal(size=(n, 3))
    return u / np.linalg.norm(u, axis=1, keepdims=True)
