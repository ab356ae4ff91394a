"""The effect that nobody has written yet: looked for in what the library leaves unexplained."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtrc

from imuloop.diagnose.choice import ratio_interval
from imuloop.diagnose.residuals import chi_square
from imuloop.diagnose.variance import likely_sizes, total
from imuloop.discover.pursuit import MARGIN, Pursued, fitted, log_p, pursue, whitened
from imuloop.discover.space import Space

# probability, over the whole space, that chance gives a composed effect, and over all it may
# depend on, that chance makes the size of one no constant
LEVEL = 0.01
# probability of what is left beside a formula, below which it is not all: more than noise
FLOOR = 0.05
# share of the searches without a part that have to give the same name, whatever its time constant,
# or one of its imitators
AGREED = 0.8
# shares of the poses after which something may be the other way round
CHANGES = (0.25, 0.5, 0.75)
# draws of each kind, in all data and where a part is held out
DRAWS, DRAWS_WITHOUT = 1000, 400


@dataclass(frozen=True)
class Discovery:
    """What a search of composed effects found.

    Attributes
    ----------
    space : Space
        What was searched.
    found : Pursued
        In all data.
    kinds : dict of str to dict
        Of each kind of residual the held-out error ``before`` and ``after``, SI, the ``ratio`` and
        its ``ratio_ci95``, the whole search repeated without each part; empty if nothing was found.
    errors : sequence of ndarray, shape (N,)
        The held-out errors themselves, before and after.
    without : tuple of Discovered
        What the search without each part finds.
    left : float
        Probability that noise leaves as much beside it; 1 where nothing is known of it beforehand.
    agreed : float
        Share of the searches without a part that give the same name, or an imitator's.
    constant : float
        Probability that chance lets its size depend as much on anything (`constancy`).
    lead : float
        By how much it is better than columns whose sign changes midway; -2 log likelihood.
    shown : dict of str to dict
        Of each kind, row by row, SI: the composed ``input``, fitted, and what of it the residual
        has ``before`` and ``after``; empty if nothing was found.
    """

    space: Space
    found: Pursued
    kinds: dict
    errors: tuple = ()
    without: tuple = ()
    left: float = 1.0
    agreed: float = 0.0
    constant: float = 1.0
    lead: float = np.inf
    shown: dict = field(default_factory=dict)

    @property
    def confirmed(self):
        """Kinds of residual whose held-out error falls for certain."""
        return [kind for kind, own in self.kinds.items() if own["ratio_ci95"][1] < 1]

    @property
    def effect(self):
        """The effect where one formula is enough, down to the noise, and confirmed; else None."""
        enough = self.left >= FLOOR and self.constant >= LEVEL and self.lead >= MARGIN
        certain = self.found.named and enough and self.agreed >= AGREED
        return self.space.effect(self.found.columns) if certain and self.confirmed else None


def discover(record, level=LEVEL):
    """Return the Discovery in what some effects of the library leave of a record.

    Parameters
    ----------
    record : Searched
        The residuals of a sensor.
    level : float
        Probability, over the whole space, that chance gives a composed effect.
    """
    rows, space = record.rows, record.space
    test = record.test and record.test(frozenset())
    found = pursue(rows, space, level=level, draws=DRAWS, seed=record.settings.seed, test=test)
    if not found.candidates:
        return Discovery(space, found, {})
    space = space.about(found.warmer)
    columns = space.columns[:, list(found.columns)]
    *errors, without = held_out(record, level)
    first, alike = found.candidates[0], found.imitators
    same = (
        w.named and (w.candidates[0] in alike or space.kin(first, w.candidates[0])) for w in without
    )
    composed, after = in_sample(rows, columns)
    series = {"input": composed, "before": composed + after, "after": after}
    shown = {
        kind: {name: values[own].tolist() for name, values in series.items()}
        for kind, (own, _) in record.kinds.items()
    }
    return Discovery(
        space,
        found,
        held_out_kinds(record, errors),
        errors,
        tuple(record.space.about(w.warmer).effect(w.columns) for w in without),
        chance_of_left(rows, columns) if record.noise_known else 1.0,
        float(np.mean(list(same))),
        constancy(record, found.columns),
        lead_over_changes(rows, space, found.columns),
        shown,
    )


def chance_of_left(rows, columns):
    """Return the probability that noise, its size within its intervals, leaves as much."""
    design = np.column_stack([rows.jacobian, columns])
    slow = [p for p in rows.parts if np.isfinite(p.deviation)]
    noise = total(rows.fixed, slow, likely_sizes(rows.values, design, rows.fixed, slow))
    (((square, dof),), _) = chi_square(rows.values, noise, design, [np.ones(len(noise), bool)])
    return float(chdtrc(dof, square))


def constancy(record, chosen):
    """Return the probability that by chance what chosen columns say depends as much on anything.

    Were the formula another, what is left would go with ``d s``: d is the fitted sum of the
    columns, s its own size or one of the record's scalars. The smallest p-value of these, times
    their number. What another reference temperature would add is no other formula.
    """
    rows, space = record.rows, record.space
    moved = tuple(k for k, term in enumerate(space.terms) if term in _moved(space, chosen))
    moved = whitened(rows, replace(space, candidates=(moved,)), chosen).kept[0] if moved else ()
    fit = in_sample(rows, space.columns[:, list(chosen)])[0]
    own = space.columns[:, [*chosen, *moved]]
    # rows of other records have no scalars
    at = np.minimum(rows.piece, len(record.scalars) - 1)
    times = fit[:, None] * np.column_stack([np.abs(fit) / np.abs(fit).max(), record.scalars[at]])
    k, m = own.shape[1], times.shape[1]
    candidates = tuple((j,) for j in range(k, k + m))
    others = replace(space, columns=np.hstack([own, times]), candidates=candidates)
    white = whitened(rows, others, tuple(range(k)))
    (least,), _ = log_p(white, white.residual[:, None])
    return float(min(m * np.exp(least), 1.0))


def lead_over_changes(rows, space, chosen):
    """Return by how much chosen columns are better than any that changes its sign midway.

    -2 log likelihood, as `Whitened.scores`; columns of the space, at `CHANGES`, but for imitators.
    The time of a change is a parameter more.
    """
    number = rows.piece + 0.5
    signs = (np.sign(number - share * (rows.piece.max() + 1)) for share in CHANGES)
    changed = [space.columns * sign[:, None] for sign in signs]
    columns, count = np.hstack([space.columns, *changed]), space.columns.shape[1]
    candidates = (tuple(chosen), *((k,) for k in range(count, columns.shape[1])))
    white = whitened(rows, replace(space, columns=columns, candidates=candidates), (), about=chosen)
    scores = white.scores()
    order = (k for k in np.argsort(-scores, kind="stable") if k and np.isfinite(scores[k]))
    best = next((scores[k] for k in order if not white.imitates(0, k)), -np.inf)
    return float(min(scores[0] - best + np.log(white.dof), 1e6))


def _moved(space, chosen):
    """Return the terms that chosen columns get with another reference temperature."""
    moved = {space.warm[c][0] for c in chosen if c in space.warm}
    return moved - {space.terms[c] for c in chosen}


def in_sample(rows, columns):
    """Return what columns add to the rows of a fit of all data, and what is left, (n,) each."""
    design = np.column_stack([rows.jacobian, columns])
    theta = fitted(rows, design)[0]
    count = columns.shape[1]
    return columns @ theta[len(theta) - count :], rows.values - design @ theta


def held_out(record, level):
    """Return errors of rows without and with what a search finds that did not see them, (N,) each.

    Each part is predicted by a search, a noise and a fit of their own; what these Pursued is third.
    """
    searches = []

    def search(seen):
        part = len(searches)
        what = record.rows.seen(seen), record.space.seen(seen)
        how = {"draws": DRAWS_WITHOUT, "seed": record.settings.seed + 1 + part}
        test = record.test and record.test(frozenset({part}))
        searches.append(pursue(*what, level=level, test=test, **how))
        found = searches[-1]
        return record.space.about(found.warmer).columns[:, list(found.columns)]

    nothing = record.space.columns[:, :0]
    return errors_of(record, lambda seen: nothing), errors_of(record, search), searches


def errors_of(record, chosen):
    """Return the errors of rows, (N,), each part predicted by a fit that did not see it.

    `chosen` takes the rows that are seen, gives columns of all, (N, q).
    """
    rows, fold = record.rows, record.fold
    errors = np.zeros(len(rows.values))
    for part in range(fold[:, 0].max() + 1):
        held = np.flatnonzero(fold[:, 0] == part)
        seen = np.flatnonzero(~(fold == part).any(axis=1))
        design = np.column_stack([rows.jacobian, chosen(seen)])
        theta = fitted(rows.seen(seen), design[seen])[0]
        errors[held] = rows.values[held] - design[held] @ theta
    return errors


def held_out_kinds(record, errors):
    """Return what a Discovery holds of each kind of residual, of errors before and after."""
    kinds = {}
    for kind, (own, components) in record.kinds.items():
        pair = [each[own, None] for each in errors]
        before, after = (float(np.sqrt(components * np.mean(e**2))) for e in pair)
        kinds[kind] = {
            "before": before,
            "after": after,
            "ratio": after / before,
            "ratio_ci95": ratio_interval(record.fold[own, 0], *pair, record.settings),
        }
    return kinds
