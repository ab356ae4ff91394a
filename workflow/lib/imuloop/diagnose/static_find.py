"""What is found in the static records of one sensor: effects that pass, and stand held-out data."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.effect import Channels, FittedEffect
from imuloop.diagnose.search import candidates
from imuloop.diagnose.static_estimate import fitted
from imuloop.diagnose.static_holdout import Blocks
from imuloop.diagnose.static_model import (
    StaticModel,
    block_of,
    derivative,
    everything,
    without_fold,
)
from imuloop.diagnose.static_search import StaticSearch, StaticTrial
from imuloop.diagnose.static_spectrum import (
    Coloured,
    coefficients,
    coloured,
    held_out_ratio,
    spectra,
)
from imuloop.diagnose.static_terms import GaussMarkov, Steps

# means without a gap between them that a spectrum needs
LEAST_IN_SPECTRUM = 16


@dataclass(frozen=True)
class Added:
    """An effect that was added.

    Attributes
    ----------
    name : str
        Its name.
    trial : StaticTrial or None
        Its trial beside those before it; None for noise.
    p_value : float
        Of the trial.
    before, after : list of ndarray, shape (n, k)
        Held-out errors without and with it, each record's: on the axis where it shows most, for
        the noise of the others says nothing of it; on all three for noise.
    ratio : list of float
        95 % interval of the ratio of these errors.
    """

    name: str
    trial: StaticTrial | None
    p_value: float
    before: list
    after: list
    ratio: list


@dataclass(frozen=True)
class Finding:
    """What was found in the static records of a sensor.

    Attributes
    ----------
    model : StaticModel
        Means and noise.
    search : StaticSearch
        Of all windows.
    blocks : Blocks
        Held-out blocks.
    others : dict of type to (str, str)
        Effects that cannot be tried: status and reason.
    base : tuple of Pattern
        Patterns that were added.
    effects : tuple of FittedEffect
        They with their parameters.
    added : tuple of Added
        All that was added, noise with a correlation time last.
    failed : dict of type to list of float
        Interval of the ratio of those that passed the test alone.
    coloured : Coloured or None
        Test for noise with a correlation time; None without enough means in a row.
    spectra : list of Spectrum
        Of the three axes, effects taken out.
    window : float
        Length of the windows of the spectra, s.
    before, after : list of ndarray, shape (n, 3)
        Held-out errors of each record; the choice of effects is made again without each block.
    """

    model: StaticModel
    search: StaticSearch
    blocks: Blocks
    others: dict
    base: tuple
    effects: tuple[FittedEffect, ...]
    added: tuple[Added, ...]
    failed: dict
    coloured: Coloured | None
    spectra: list
    window: float
    before: list
    after: list

    @property
    def has_process(self):
        """Whether noise with a correlation time was added."""
        return any(a.name == GaussMarkov.name for a in self.added)


def static_candidates(sensor, records):
    """Return what `candidates` does for a sensor in static records."""

    def joined(name):
        parts = [getattr(r.channels, name) for r in records]
        return None if any(p is None for p in parts) else np.concatenate(parts)

    channels = Channels(*(joined(n) for n in ("t", "output", "other", "temperature")))
    return candidates(sensor, "static_record", channels)


def find(sensor, records, fine, settings, tests, noise=None):
    """Search the static records of a sensor.

    Parameters
    ----------
    sensor : str
        The sensor.
    records, fine : sequence of StaticRecord
        Its means, and those over the shortest windows, for the spectrum.
    settings : DiagnoseSettings
        Settings.
    tests : int
        Number of tests of the family.
    noise : sequence of GridNoise, optional
        That of the other sensor's model of the same windows.
    """
    model = StaticModel(records, noise)
    available, others = static_candidates(sensor, records)
    shapes = {cls: model.patterns(s) for cls, s in available.items() if s}
    arguments = shapes, settings.significance, tests
    search = StaticSearch(everything(model), *arguments)
    blocks = Blocks(
        model,
        [
            StaticSearch(without_fold(model, k, settings.blocks), *arguments)
            for k in range(settings.blocks)
        ],
    )
    base, added, failed = _greedy(search, blocks, settings)
    after = before = blocks.errors([()] * settings.blocks)
    if base:
        # as many effects as were added; which ones is chosen again without each block
        after = blocks.errors([s.greedy(len(base), failed) for s in blocks.searches])
    effects = fitted(search, base)
    axes, in_blocks, window = _spectra(fine, base, effects, settings.blocks)
    test = coloured(axes, window) if axes else None
    if test and test.log_p < search.threshold(len(base)):
        shrunk, ratio = held_out_ratio(in_blocks, test.tc / window, settings)
        if ratio[1] < 1:
            # the error itself does not fall: what is foreseen of it does
            foreseen = [shrunk * e for e in after]
            added = (*added, Added(GaussMarkov.name, None, test.p_value, after, foreseen, ratio))
        else:
            failed = failed | {GaussMarkov: ratio}
    return Finding(
        model, search, blocks, others, base, effects, added, failed, test, axes, window,
        before, after,
    )  # fmt: skip


def _greedy(search, blocks, settings):
    """Return the patterns that pass test and held-out data, what was added, and what failed."""
    base, added, failed = (), (), {}
    classes, before = (), blocks.errors([()] * len(blocks.searches))
    while best := search.best(base, failed):
        cls = type(best.pattern.effect)
        if cls is Steps:
            blocks.know(best)
        after = blocks.errors([s.following((*classes, cls)) for s in blocks.searches])
        own = [[e[:, [best.axis]] for e in errors] for errors in (before, after)]
        ratio = blocks.ratio_interval(*own, settings)
        if ratio[1] >= 1:
            failed[cls] = ratio
            if cls is Steps:
                blocks.know(None)
            continue
        added = (*added, Added(cls.name, best, best.p_value, *own, ratio))
        # what did not stand beside this effect's own pattern may stand without it
        failed = {}
        base, classes, before = search.reshaped((*base, best.pattern)), (*classes, cls), after
    return base, added, failed


def _spectra(fine, base, effects, count):
    """Return the spectra of all axes, the coefficients of each block, and the window, s."""
    parts, in_blocks = [], [[] for _ in range(count)]
    for record in fine:
        left = record.values - sum(
            derivative(p.effect, record) @ np.array([e.values[n] for n in e.effect.parameters])
            for p, e in zip(base, effects, strict=True)
        )
        blocks = block_of(record, count)
        # a number for each run of windows that touch
        gap = np.diff(record.windows[:, 0], prepend=-np.inf) > 1.5 * record.length
        run = np.cumsum(gap | (np.diff(record.stretch, prepend=-1) != 0))
        for number in np.unique(run):
            rows = run == number
            if rows.sum() >= LEAST_IN_SPECTRUM:
                parts.append(coefficients(left[rows]))
            for k in range(count):
                if (rows & (blocks == k)).sum() >= LEAST_IN_SPECTRUM:
                    in_blocks[k].append(coefficients(left[rows & (blocks == k)]))
    window = float(np.median(fine[0].length))
    if not parts or not all(in_blocks):
        return [], [], window
    return spectra(parts), in_blocks, window
