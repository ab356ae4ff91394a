"""Effects that these data cannot tell apart, judged by their patterns and by the tests.

The pattern of an effect is the derivative of all rows (scalar residuals) with respect to its
parameters. Each of its columns belongs to one parameter and one axis.
"""

from itertools import permutations

import numpy as np

# share from which on one effect imitates another. An effect of three times its detection limit has
# nine times the noncentrality of one at the limit; if another effect explains 8/9 of that, what
# remains is at the limit
SHARE = 8 / 9
# share from which on two patterns count as the same
ONE = 0.999
# columns of length one count as linearly dependent if an eigenvalue of their Gram matrix is below
# this
SINGULAR = 1e-9


def share_on_axes(training_fit, first, second):
    """Return the share of one effect that a second effect can explain, from 0 to 1.

    An effect explains another one if it changes the rows in the same way, with some values of its
    parameters. The square of an effect is the weighted sum of squares of its change of the rows.
    On each axis on which the first effect acts, `imitated_share` gives the share of its square that
    the second explains at least, for any parameters of the first. The result is the smallest of
    these shares. `training_fit` is the TrainingFit of the rows; `first` and `second` are Effects
    with their constants.
    """
    first_pattern, second_pattern = training_fit.evidence.patterns((first, second))
    # by axis, the numbers of the columns of both effects; axes with the same columns count once. An
    # effect without columns on an axis does not act there
    pairs = set(zip(first_pattern.columns, second_pattern.columns, strict=True))
    return min(imitated_share(training_fit, one, other) for one, other in pairs if one)


def imitated_share(training_fit, first, second):
    """Return the share of one effect that a second one can explain on one axis, from 0 to 1.

    The pattern of an effect is the derivative of all rows with respect to its parameters. The
    nuisance parameters, which every fit has, are projected out of the patterns. The share is
    ``cos²`` of the largest principal angle between the two patterns. So the second effect explains
    at least this share of the first one, for any parameters of the first: of the weighted sum of
    squares of its change of the rows. The weights are the inverse of the noise covariance that is
    likeliest without effects.

    The share is zero if the second effect has fewer columns than the first, or if the columns of
    one of the effects are linearly dependent.

    Parameters
    ----------
    training_fit : TrainingFit
        Least squares of the rows.
    first, second : tuple of int
        Numbers, in the Evidence, of the columns that each effect has on the axis.
    """
    if len(first) > len(second):
        return 0.0
    columns, k = (*first, *second), len(first)
    # axis 0 stands for all: the noise of the axes differs by a factor only
    hypothesis = training_fit.hypothesis(training_fit.fit((), 0))
    gram = training_fit.products(columns, columns)[hypothesis]
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    if not size.all():
        return 0.0
    gram = gram / np.outer(size, size)
    blocks = gram[:k, :k], gram[k:, k:]
    if min(np.linalg.eigvalsh(block)[0] for block in blocks) <= SINGULAR:
        return 0.0
    # singular values of the products of orthonormal columns of both effects are cosines of the
    # principal angles: the least one belongs to the largest angle
    roots = [np.linalg.cholesky(block) for block in blocks]
    mixed = np.linalg.solve(roots[0], np.linalg.solve(roots[1], gram[k:, :k]).T)
    return float(np.linalg.svd(mixed, compute_uv=False)[-1] ** 2)


def imitations(search, kinds):
    """Return the pairs of kinds of effects that these data can hardly tell apart, a list of dict.

    A dict has the names of the two kinds: ``effect``, which is imitated, and ``with``, which
    imitates it. It also has the ``share`` of the first kind's square that the second explains. The
    square is the weighted sum of squares of the change of the rows by an effect of the first kind.
    Pairs with a share below `SHARE` are left out.

    A kind has variants, effects with values of their constants. For each variant of the first kind,
    the variant of the second kind that explains most of it is taken (`share_on_axes`). The share of
    the pair is the median over the variants of the first kind.

    Parameters
    ----------
    search : Search
        The search in all rows, with the variants of each kind.
    kinds : sequence
        The kinds to compare; a kind without a variant that can be estimated is left out.
    """
    # a model without effects
    training_fit, variants_by_kind, pairs = search.training_fit(()), {}, []
    for kind in kinds:
        variants = search.problem.variants.get(kind, ())
        if testable := [trial.effect for trial in search.tests((), variants) if trial]:
            variants_by_kind[kind] = testable
    for (kind, variants), (other, other_variants) in permutations(variants_by_kind.items(), 2):
        shares = [max(share_on_axes(training_fit, a, b) for b in other_variants) for a in variants]
        share = float(np.median(shares))
        if share >= SHARE:
            pairs.append({"effect": kind.name, "with": other.name, "share": share})
    return pairs


def twin(search, base, kind):
    """Return the name of an effect in the model that a candidate could replace, or None.

    The candidate is another kind of effect. An effect in the model is its twin if two things hold:
    the candidate passes the significance test in a model without the effect, and the effect fails
    it in a model with the candidate. The candidate is then reported as confounded with the twin.
    The result is None if no effect in the model is a twin. `search` is the Search in all rows,
    `base` has the effects in the model, and `kind` is the kind of the candidate.
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
    """Return the name of an effect in the model that prevents the test of a candidate, or None.

    The candidate is another kind of effect. Next to all effects in the model the candidate cannot
    be estimated; if the returned effect is left out of the model, it can. The candidate is then
    reported as confounded with this effect. The result is None if there is no such effect. `search`
    is the Search in all rows, `base` has the effects in the model, and `kind` is the kind of the
    candidate.
    """
    alone = search.trial((), kind)
    for effect in base if alone else ():
        if search.test(tuple(e for e in base if e is not effect), alone.effect):
            return effect.name
    return None
