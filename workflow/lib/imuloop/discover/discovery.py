"""The effect that nobody has written yet: looked for in what the library leaves unexplained."""

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.special import chdtrc

from imuloop.calibrate.least_squares import chi_square
from imuloop.calibrate.noise_components import likely_sizes, total
from imuloop.diagnose.choice import ratio_interval
from imuloop.discover.selection import LEVEL, MARGIN, Selection, log_p, select, whitened
from imuloop.discover.space import Space
from imuloop.effects.discovered import Discovered

# probability of what is left beside a formula, below which it is not all: more than noise
FLOOR = 0.05
# least share of the searches without a part that give the same name, or an imitator's
AGREED = 0.8
# shares of the poses after which something may be the other way round
CHANGES = (0.25, 0.5, 0.75)
# draws of each kind, in all data and where a part is held out
DRAWS, DRAWS_WITHOUT = 1000, 400


AT_REST = {"gravity_norm"}


@dataclass(frozen=True)
class Discovery:
    """What a search of composed effects found, and what confirms it."""

    space: Space  # its reference temperature is the one that was found
    selection: Selection  # in all data
    # of each kind of residual the held-out errors `before` and `after`, SI, their `ratio` and its
    # `ratio_ci95`, the whole search repeated without each part; empty if nothing was selected
    kinds: dict = field(default_factory=dict)
    heldout: np.ndarray | None = None  # (N,): the held-out errors after
    part_effects: tuple[Discovered, ...] = ()  # what the search without each part finds
    agreed: float = 0.0  # share of these that have the same name, or an imitator's
    noise_chance: float = 1.0  # that noise leaves as much; 1 where nothing is known of it before
    constant: float = 1.0  # as of `constancy`
    lead: float = np.inf  # as of `lead_over_changes`
    # of each kind, row by row, SI: the `input` that is composed and fitted, and what of it the
    # residual has `before` and `after`
    points: dict = field(default_factory=dict)

    @property
    def confirmed(self):
        """Kinds of residual whose held-out error falls for certain."""
        return [kind for kind, own in self.kinds.items() if own["ratio_ci95"][1] < 1]

    @property
    def effect(self):
        """The effect where one formula is enough, down to the noise, and confirmed; else None."""
        enough = self.noise_chance >= FLOOR and self.constant >= LEVEL and self.lead >= MARGIN
        clear = self.selection.single and self.selection.clear
        certain = clear and enough and self.agreed >= AGREED
        return self.space.effect(self.selection.columns) if certain and self.confirmed else None


def discover(record):
    """Return the Discovery in a SearchInput: what some effects of the library leave of a record."""
    rows, space, seed = record.rows, record.space, record.problem.settings.seed
    test = record.test and partial(record.test, frozenset())
    selection = select(rows, space, draws=DRAWS, seed=seed, test=test)
    if not selection.candidates:
        return Discovery(space, selection)
    by_part = []
    for k, (_, seen) in enumerate(record.held_and_seen):
        without_part = rows.subset(seen), replace(space, columns=space.columns[seen])
        test = record.test and partial(record.test, frozenset({k}))
        by_part.append(select(*without_part, draws=DRAWS_WITHOUT, seed=seed + 1 + k, test=test))
    effects, columns = zip(*(own.seen_by(space) for own in by_part), strict=True)
    before = heldout_errors(record, [space.columns[:, :0]] * len(by_part))
    heldout = heldout_errors(record, columns)
    # a pattern that is not the formula's shows at rest, where no rotation dilutes it
    alone = record.of_pair and space.sensor == "accelerometer" and record.kinds.keys() <= AT_REST
    judged_in = (record, record.of_gravity_alone()) if alone else (record,)
    alike = space.kin(selection.candidates[0]) | {*selection.imitators}
    columns = selection.seen_by(space)[1]
    composed, residual = in_sample(rows, columns)
    points = {"input": composed, "before": composed + residual, "after": residual}
    shifted = space.warmer(selection.warmer)
    return Discovery(
        shifted,
        selection,
        kinds=error_ratios(record, before, heldout),
        heldout=heldout,
        part_effects=effects,
        agreed=float(np.mean([own.single and own.candidates[0] in alike for own in by_part])),
        noise_chance=noise_chance(record, columns) if record.of_pair else 1.0,
        constant=min(constancy(each, selection.columns) for each in judged_in),
        lead=lead_over_changes(rows, shifted, selection.columns),
        points={
            kind: {name: values[own].tolist() for name, values in points.items()}
            for kind, (own, _) in record.kinds.items()
        },
    )


def noise_chance(record, columns):
    """Return the probability that known noise leaves as much beside columns, (N, q), in a kind.

    The smallest of the kinds of residual, times their number: what is left in one is not hidden by
    the rows of others.
    """
    rows = record.rows
    parts = [part for part in rows.parts if np.isfinite(part.deviation)]
    design = rows.design(columns)
    covariance = total(rows.fixed, parts, likely_sizes(rows.values, design, rows.fixed, parts))
    groups = [own for own, _ in record.kinds.values()]
    squares, _ = chi_square(rows.values, covariance, design, groups)
    return float(min(1.0, len(groups) * min(chdtrc(dof, square) for square, dof in squares)))


def in_sample(rows, columns):
    """Return what columns add to the rows of a fit of all data, and what is left, (n,) each."""
    theta = rows.fit(columns)[0]
    return columns @ theta[rows.jacobian.shape[1] :], rows.values - rows.design(columns) @ theta


def heldout_errors(record, columns):
    """Return errors of rows, (N,), each part predicted without it, by its own columns, (N, q)."""
    rows, errors = record.rows, np.zeros(len(record.rows.values))
    for (held, seen), own in zip(record.held_and_seen, columns, strict=True):
        theta = rows.subset(seen).fit(own[seen])[0]
        errors[held] = rows.values[held] - rows.design(own)[held] @ theta
    return errors


def error_ratios(record, before, after):
    """Return the `kinds` of a Discovery by held-out errors without and with what was found."""
    kinds = {}
    for kind, (own, components) in record.kinds.items():
        pair = [each[own, None] for each in (before, after)]
        old, new = (float(np.sqrt(components * np.mean(e**2))) for e in pair)
        interval = ratio_interval(record.row_parts[own, 0], *pair, record.problem.settings)
        kinds[kind] = {"before": old, "after": new, "ratio": new / old, "ratio_ci95": interval}
    return kinds


def constancy(record, selected):
    """Return the probability that by chance selected columns' size depends as much on anything.

    Were the formula another, what is left would go with ``d s``: d is the fitted sum of the
    columns, s its own size or one of the record's scalars. The smallest p-value of these, times
    their number. What another reference temperature would add is no other formula.
    """
    rows, space = record.rows, record.space
    lower = {space.lower_powers[c][0] for c in selected if c in space.lower_powers}
    moved = sorted(lower - {None, *selected})
    (moved,) = whitened(rows, space.columns, (moved,), selected).columns
    fit = in_sample(rows, space.columns[:, list(selected)])[0]
    own = space.columns[:, [*selected, *moved]]
    # rows of other records have no scalars
    scalars = record.scalars[np.minimum(rows.pose, len(record.scalars) - 1)]
    times = fit[:, None] * np.column_stack([np.abs(fit) / np.abs(fit).max(), scalars])
    k, m = own.shape[1], times.shape[1]
    candidates = [(j,) for j in range(k, k + m)]
    white = whitened(rows, np.hstack([own, times]), candidates, range(k))
    (least,) = log_p(white, white.residual[:, None])
    return float(min(m * np.exp(least), 1.0))


def lead_over_changes(rows, space, selected):
    """Return by how much selected columns are better than any whose sign changes midway.

    -2 log likelihood, as `Whitened.scores`; its own imitators do not count, and the time of a
    change is a parameter more.
    """
    number, count = rows.pose + 0.5, space.columns.shape[1]
    signs = (np.sign(number - share * (rows.pose.max() + 1)) for share in CHANGES)
    columns = np.hstack([space.columns, *(space.columns * sign[:, None] for sign in signs)])
    candidates = [selected, *((k,) for k in range(count, columns.shape[1]))]
    white = whitened(rows, columns, candidates, (), noise_beside=selected)
    scores = white.scores()
    order = (k for k in np.argsort(-scores, kind="stable") if k and np.isfinite(scores[k]))
    best = next((scores[k] for k in order if not white.imitates(0, k)), -np.inf)
    return float(min(scores[0] - best + np.log(white.dof), 1e6))
