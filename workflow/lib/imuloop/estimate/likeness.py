"""Effects that these data cannot tell apart: by their patterns, and by the fit."""

from itertools import permutations

import numpy as np

# an effect of three detection limits has nine times the noncentrality of one; what a twin leaves of
# it is below the detection limit where the twin takes eight ninths
SHARE = 8 / 9
# share from which on two patterns are one
ONE = 0.999


def imitated_share(training_fit, base, first, second, axis=0):
    """Return the share of a pattern that another imitates, and the reverse.

    ``cos²`` of the largest principal angle between the columns that nuisances and base leave:
    whatever its parameters, the other takes that share of its square at least. At the likeliest
    noise of the base model.
    """
    columns_of = training_fit.evidence.columns_of
    known, own, other = (columns_of(e, axis) for e in (base, (first,), (second,)))
    columns, k, m = (*known, *own, *other), len(known), len(known) + len(own)
    gram = training_fit.gram(columns)[training_fit.hypothesis(training_fit.fit(base, 0))]
    if k:
        gram = gram - gram[:, :k] @ np.linalg.solve(gram[:k, :k], gram[:k])
    roots = [_root(gram[s, s]) for s in (slice(k, m), slice(m, None))]
    if any(r is None for r in roots):
        return 0.0, 0.0
    cosines = np.linalg.svd(roots[0] @ gram[k:m, m:] @ roots[1].T, compute_uv=False)
    least, more = float(cosines[-1] ** 2), len(own) - len(other)
    return (least if more <= 0 else 0.0), (least if more >= 0 else 0.0)


def _root(gram):
    """Return R with ``R G Rᵀ = 1``, None where the columns are not independent."""
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    if not size.all():
        return None
    values, axes = np.linalg.eigh(gram / np.outer(size, size))
    if values[0] <= 1e-9:
        return None
    return (axes / np.sqrt(values)).T / size


def imitated(search, kinds):
    """Return which effects of some kinds others of them imitate, from their patterns alone.

    A list of ``effect``, ``with`` and ``share``, where it is at least `SHARE`: of the middle one of
    the effect's shapes, by the nearest one of the other's; of the axis where it is least.
    """
    training_fit, shapes = search.training_fit(()), {}
    for kind in kinds:
        own = search.problem.shapes.get(kind, ())
        tried = search.tests((), own)
        seen = [s for s, t in zip(own, tried, strict=True) if t]
        if seen:
            shapes[kind] = seen
    found = []
    for kind, other in permutations(shapes, 2):
        others = shapes[other]
        shares = [max(share_on_axes(training_fit, a, b) for b in others) for a in shapes[kind]]
        share = float(np.median(shares))
        if share >= SHARE:
            found.append({"effect": kind.name, "with": other.name, "share": share})
    return found


def share_on_axes(training_fit, a, b):
    """Return the share of one effect that another takes on the axis where it takes least."""
    own, other = (pattern.columns for pattern in training_fit.evidence.patterns((a, b)))
    axes = [axis for axis, columns in enumerate(own) if columns]
    if not all(other[axis] for axis in axes):
        return 0.0
    return min(imitated_share(training_fit, (), a, b, axis)[0] for axis in axes)


def twin(search, base, kind):
    """Return the name of an added effect that a candidate could stand in for, or None.

    It could if in its place it passes the test, and the effect beside it then does not.
    """
    for effect in reversed(base):
        others = tuple(e for e in base if e is not effect)
        instead = search.trial(others, kind)
        if not instead or instead.impossible or instead.log_p >= search.threshold(len(others)):
            continue
        beside = search.test((*others, instead.effect), effect)
        if beside is None or beside.log_p >= search.threshold(len(base)):
            return effect.name
    return None


def holder(search, base, kind):
    """Return the added effect without which a candidate can be tried, or None."""
    alone = search.trial((), kind)
    for effect in base if alone else ():
        if search.test(tuple(e for e in base if e is not effect), alone.effect):
            return effect.name
    return None
