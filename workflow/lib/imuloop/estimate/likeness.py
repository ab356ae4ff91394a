"""Effects that these data cannot tell apart, judged by their patterns and by the tests."""

from itertools import permutations

import numpy as np

# share from which on one effect imitates another. An effect of three times its detection limit has
# nine times the noncentrality; if another effect explains 8/9 of it, the rest is at the limit
SHARE = 8 / 9
# share from which on two patterns count as the same
ONE = 0.999


def share_on_axes(training_fit, first, second):
    """Return the share of the first effect that the second imitates, on the axis with the least.

    `training_fit` is the TrainingFit of the rows.
    """
    first_pattern, second_pattern = training_fit.evidence.patterns((first, second))
    pairs = zip(first_pattern.columns, second_pattern.columns, strict=True)
    return min(imitated_share(training_fit, *pair) for pair in pairs if pair[0])


def imitated_share(training_fit, first, second):
    """Return the share of the first effect that the second one imitates on one axis.

    The share is ``cos²`` of the largest principal angle between the patterns of both effects, after
    the nuisance parameters are projected out. The second effect explains at least this share of the
    square of the first one, whatever the parameters of the first. It is zero if the second has
    fewer columns. The metric is the likeliest noise hypothesis without effects.

    Parameters
    ----------
    training_fit : TrainingFit
    first, second : tuple of int
        Numbers of the columns that both effects have on the axis.
    """
    if len(first) > len(second):
        return 0.0
    columns, k = (*first, *second), len(first)
    hypothesis = training_fit.hypothesis(training_fit.fit((), 0))
    gram = training_fit.products(columns, columns)[hypothesis]
    roots = [_root(gram[:k, :k]), _root(gram[k:, k:])]
    if any(root is None for root in roots):
        return 0.0
    cosines = np.linalg.svd(roots[0] @ gram[:k, k:] @ roots[1].T, compute_uv=False)
    return float(cosines[-1] ** 2)


def _root(gram):
    """Return R with ``R G Rᵀ = 1`` for a Gram matrix G, (k, k); None if G is singular."""
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
    training_fit, shapes_by_kind, pairs = search.training_fit(()), {}, []
    for kind in kinds:
        shapes = search.problem.shapes.get(kind, ())
        if testable := [trial.effect for trial in search.tests((), shapes) if trial]:
            shapes_by_kind[kind] = testable
    for (kind, shapes), (other, other_shapes) in permutations(shapes_by_kind.items(), 2):
        shares = [max(share_on_axes(training_fit, a, b) for b in other_shapes) for a in shapes]
        share = float(np.median(shares))
        if share >= SHARE:
            pairs.append({"effect": kind.name, "with": other.name, "share": share})
    return pairs


def twin(search, base, kind):
    """Return the name of an effect that a candidate could replace, or None.

    It could if the candidate passes the test without this effect in the model, and the effect does
    not pass it with the candidate in the model. `base` has the effects in the model, and `kind` is
    the kind of the candidate.
    """
    for effect in reversed(base):
        other_effects = tuple(e for e in base if e is not effect)
        trial = search.trial(other_effects, kind)
        if not trial or trial.impossible or trial.log_p >= search.threshold(len(other_effects)):
            continue
        reverse = search.test((*other_effects, trial.effect), effect)
        if reverse is None or reverse.log_p >= search.threshold(len(base)):
            return effect.name
    return None


def masking_effect(search, base, kind):
    """Return the name of an effect that prevents the trial of a candidate, or None.

    Without this effect in the model the candidate can be estimated. `base` has the effects in the
    model, and `kind` is the kind of the candidate.
    """
    alone = search.trial((), kind)
    for effect in base if alone else ():
        if search.test(tuple(e for e in base if e is not effect), alone.effect):
            return effect.name
    return None
