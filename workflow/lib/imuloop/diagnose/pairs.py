"""Pairs of effects: two of like size hide each other, each alone leaves the other behind."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from imuloop.core.effect import Effect
from imuloop.diagnose.trial import log_p_value
from imuloop.diagnose.twins import SHARE, imitated_share


@dataclass(frozen=True)
class Pair:
    """Two effects tested together against the model without either.

    Attributes
    ----------
    effects : tuple of Effect
        The two, in their shapes.
    columns : tuple of int
        Which shapes of the linear model they are.
    log_p : float
        Logarithm of the p-value of the F test of both, times the number of pairs of shapes.
    pattern : ndarray, shape (n, q)
        Whitened columns of both that the other parameters leave.
    values : ndarray, shape (q,)
        Parameters of both.
    """

    effects: tuple[Effect, Effect]
    columns: tuple[int, int]
    log_p: float
    pattern: np.ndarray
    values: np.ndarray


def best_pair(white, doubts, shapes, banned, log_threshold):
    """Return the pair of effects that passes with the smallest p-value, or None.

    Both together have to pass, and each beside the other, by the test that single effects have.
    Twins are no pair: what both fit where neither fits alone is the little that tells them apart.
    Effects whose size physics limits are tried alone only.

    Parameters
    ----------
    white : White
        Residuals weighted by the noise model.
    doubts : sequence of White
        The same with other weights, which a pair has to pass with, too.
    shapes : sequence of Effect
        The shapes of their columns.
    banned : collection of (type, type)
        Pairs that are left out.
    log_threshold : float
        Logarithm of the largest p-value that passes.
    """
    pairs = [
        (i, j)
        for i, j in combinations([k for k, s in enumerate(shapes) if np.isinf(s.limit)], 2)
        if type(shapes[i]) is not type(shapes[j])
        and (type(shapes[i]), type(shapes[j])) not in banned
    ]
    ways = [_Left.of(w) for w in (white, *doubts)]
    least = (1.0, *(0.0 for _ in doubts))
    best = None
    for i, j in pairs:
        both, first, second = [], [], []
        for way, floor in zip(ways, least, strict=False):
            tests = way.tests(i, j, floor)
            if tests is None:
                break
            for kept, value in zip((both, first, second), tests, strict=True):
                kept.append(value)
        if len(both) < len(ways):
            continue
        joint = max(both) + np.log(len(pairs))
        if max(joint, max(first), max(second)) >= log_threshold:
            continue
        if best is None or joint < best[0]:
            best = joint, i, j
    if best is None:
        return None
    joint, i, j = best
    pattern = np.hstack([white.left(white.columns[k]) for k in (i, j)])
    values = -np.linalg.lstsq(pattern, white.rest, rcond=None)[0]
    return Pair((shapes[i], shapes[j]), (i, j), joint, pattern, values)


@dataclass(frozen=True)
class _Left:
    """What the parameters leave of residual and columns, orthonormal, and χ² with each alone."""

    residual: np.ndarray
    spaces: list
    alone: np.ndarray
    dof: int

    @classmethod
    def of(cls, white):
        total = white.rest @ white.rest
        each = list(zip(white.spaces, white.seen, strict=True))
        spaces = [s.q if seen else None for s, seen in each]
        alone = [total - s.drop if seen else np.inf for s, seen in each]
        return cls(white.rest, spaces, np.array(alone), len(white.rest) - white.q.shape[1])

    def tests(self, i, j, least):
        """Return the logarithms of the p-values of both, the first and the second, or None."""
        a, b = self.spaces[i], self.spaces[j]
        if a is None or b is None:
            return None
        q, dof = (a.shape[1], b.shape[1]), self.dof - a.shape[1] - b.shape[1]
        if max(imitated_share(a, b), imitated_share(b, a)) >= SHARE:
            return None
        rest = b - a @ (a.T @ b)
        if dof < 1 or np.linalg.svd(rest, compute_uv=False)[-1] < 1e-3:
            return None
        total = self.residual @ self.residual
        after = self.alone[i] - ((np.linalg.qr(rest)[0].T @ self.residual) ** 2).sum()
        return (
            log_p_value(total - after, after, sum(q), dof, least),
            log_p_value(self.alone[j] - after, after, q[0], dof, least),
            log_p_value(self.alone[i] - after, after, q[1], dof, least),
        )
