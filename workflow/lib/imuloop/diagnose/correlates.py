"""What a residual correlates with: hints for a person, not effects."""

import numpy as np
from scipy.linalg import orth

# singular value of a probe's columns, over the largest, that counts as a column of its own
LEAST = 1e-6


def correlates(search, base, probes):
    """Return what share of the residual each probe takes, the most significant first.

    ``share = 1 - (χ²₁/ν₁)/(χ²₀/ν₀)``, by the noise as estimated and summed over the axes, not below
    0, with the p-value of the test that effects have.

    `search` is that of all data, `base` the effects that were added; each of the probes has a name,
    the kind of residual, and columns, (N, a, q).
    """
    found, training_fit = [], search.training_fit(base)
    for name, kind, columns in probes:
        training_fit.evidence.add_pattern((name, kind), _independent(columns))
        trial = search.test(base, (name, kind))
        if trial is None:
            continue
        (pattern,) = training_fit.evidence.patterns(((name, kind),))
        squares = np.zeros(2)
        for axis in range(training_fit.evidence.axes):
            fits = (training_fit.fit(e, axis) for e in (base, (*base, (name, kind))))
            squares += [f.square[0] / f.dof for f in fits]
        found.append(
            {
                "name": name,
                "residual": kind,
                "columns": sum(map(len, pattern.columns)),
                "share": float(np.clip(1 - squares[1] / squares[0], 0, 1)),
                "p_value": trial.p_value,
            }
        )
    return sorted(found, key=lambda c: (c["p_value"], -c["share"]))


def _independent(columns):
    """Return columns that span the same on each axis, none of them by others: (N, a, q)."""
    found = [np.zeros((*columns.shape[:2], 0))]
    for axis, unit in enumerate(np.eye(columns.shape[1])):
        own = columns[:, axis]
        size = np.linalg.norm(own, axis=0)
        if size.any():
            u = orth(own[:, size > 0] / size[size > 0], rcond=LEAST)
            found.append(u[:, None] * unit[:, None])
    return np.concatenate(found, axis=2)
