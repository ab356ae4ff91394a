"""Effects that these data cannot tell apart, judged by their patterns and by the tests."""

from itertools import permutations

import numpy as np

# share from which on one effect imitates another. An effect of three times its detection limit has
# nine times the noncentrality; if another effect explains 8/9 of it, the rest is at the limit
SHARE = 8 / 9
# share from which on two patterns count as the same
ONE = 0.999


def imitated_share(training_fit, base, first, second, axis=0):
    """Return the share of the first effect that the second one imitates, and the reverse.

    The share is ``cos²`` of the largest principal angle between the patterns of both effects on one
    axis, after the nuisance parameters and the base are projected out. The second effect explains
    at least this share of the square of the first one, whatever the parameters of the first. The
    metric is the likeliest noise hypothesis of the base model.
    """
    columns_of = training_fit.evidence.columns_of
    shared, own, other = (columns_of(e, axis) for e in (base, (first,), (second,)))
    columns, k, m = (*shared, *own, *other), len(shared), len(shared) + len(own)
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
    """Return R with ``R G Rᵀ = 1`` for a Gram matrix G; None if G is singular."""
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    if not size.all():
        return None
    values, axes = np.linalg.eigh(gram / np.outer(size, size))
    if values[0] <= 1e-9:
        return None
    return (axes / np.sqrt(values)).T / size


def imitations(search, kinds):
    """Return the pairs of kinds of which one imitates the other, judged by their patterns alone.

    Each pair is a dict with the names ``effect`` and ``with``, and the ``share`` of the first that
    the second imitates, if it is at least `SHARE`. For each shape of the first kind the best shape
    of the second is taken, on the axis with the least share; the share is the median over the
    shapes of the first kind.
    """
    training_fit, shapes = search.training_fit(()), {}
    for kind in kinds:
        own = search.problem.shapes.get(kind, ())
        trials = search.tests((), own)
        testable = [s for s, t in zip(own, trials, strict=True) if t]
        if testable:
            shapes[kind] = testable
    pairs = []
    for kind, other in permutations(shapes, 2):
        others = shapes[other]
        shares = [max(share_on_axes(training_fit, a, b) for b in others) for a in shapes[kind]]
        share = float(np.median(shares))
        if share >= SHARE:
            pairs.append({"effect": kind.name, "with": other.name, "share": share})
    return pairs


def share_on_axes(training_fit, a, b):
    """Return the share of effect a that effect b imitates, on the axis with the least share."""
    own, other = (pattern.columns for pattern in training_fit.evidence.patterns((a, b)))
    axes = [axis for axis, columns in enumerate(own) if columns]
    if not all(other[axis] for axis in axes):
        return 0.0
    return min(imitated_share(training_fit, (), a, b, axis)[0] for axis in axes)


def twin(search, base, kind):
    """Return the name of an effect in the base that a candidate could replace, or None.

    It could if the candidate passes the test without this effect in the base, and the effect does
    not pass it with the candidate in the base.
    """
    for effect in reversed(base):
        others = tuple(e for e in base if e is not effect)
        instead = search.trial(others, kind)
        if not instead or instead.impossible or instead.log_p >= search.threshold(len(others)):
            continue
        again = search.test((*others, instead.effect), effect)
        if again is None or again.log_p >= search.threshold(len(base)):
            return effect.name
    return None


def holder(search, base, kind):
    """Return the name of an effect in the base that prevents the trial of a candidate, or None.

    Without this effect in the base the candidate can be estimated.
    """
    alone = search.trial((), kind)
    for effect in base if alone else ():
        if search.test(tuple(e for e in base if e is not effect), alone.effect):
            return effect.name
    return None
