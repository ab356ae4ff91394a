"""What is found in the static records of one sensor: effects that pass, and stand held-out data."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.effect import Channels, FittedEffect
from imuloop.diagnose.search import candidates
from imuloop.diagnose.static_estimate import fitted, output
from imuloop.diagnose.static_holdout import Blocks, Choice
from imuloop.diagnose.static_model import StaticModel, derivative, fold_of
from imuloop.diagnose.static_spectrum import (
    Coloured,
    coefficients,
    coloured,
    held_out_ratio,
    spectra,
)
from imuloop.effects.gauss_markov import GaussMarkov

# means without a gap between them that a spectrum needs
LEAST_IN_SPECTRUM = 16


@dataclass(frozen=True)
class Process:
    """What the spectra say of noise with a correlation time.

    Attributes
    ----------
    test : Coloured
        Test.
    spectra : list of Spectrum
        Of the three axes, effects taken out.
    window : float
        Length of the windows of the spectra, s.
    share : float
        By how much it shrinks the error that held-out means are expected to have.
    ratio : list of float
        95 % interval of this share.
    """

    test: Coloured
    spectra: list
    window: float
    share: float
    ratio: list


@dataclass(frozen=True)
class Finding:
    """What was found in the static records of a sensor.

    Attributes
    ----------
    blocks : Blocks
        Held-out blocks; their model holds means and noise.
    others : dict of type to (str, str)
        Effects that cannot be tried: status and reason.
    choice : Choice
        What was added.
    effects : tuple of FittedEffect
        The same with their parameters.
    process : Process or None
        Test for noise with a correlation time; None without enough means in a row.
    has_process : bool
        Whether such noise was added.
    before, after : list of ndarray, shape (n, 3)
        Held-out errors of each record: the whole search is made again without each block.
    """

    blocks: Blocks
    others: dict
    choice: Choice
    effects: tuple[FittedEffect, ...]
    process: Process | None
    has_process: bool
    before: list
    after: list

    @property
    def model(self):
        """Means and noise."""
        return self.blocks.model

    @property
    def search(self):
        """The search of all windows."""
        return self.blocks.search()

    @property
    def base(self):
        """Patterns that were added."""
        return self.choice.base

    @property
    def added(self):
        """Names of all that was added, noise with a correlation time last."""
        names = [p.trial.pattern.name for p in self.choice.passed]
        return names + [GaussMarkov.name] * self.has_process


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
    blocks = Blocks(model, shapes, settings, tests)
    choice = blocks.choice()
    before = blocks.following(())
    after = blocks.errors(blocks.nested)
    process = _process(fine, blocks, settings)
    has_process = bool(
        process is not None
        and process.test.log_p < blocks.search().threshold(len(choice.base))
        and process.ratio[1] < 1
    )
    effects = fitted(blocks.search(), choice.base)
    return Finding(blocks, others, choice, effects, process, has_process, before, after)


def _process(fine, blocks, settings):
    """Return the Process of the means over the shortest windows, or None."""
    derivatives = {}

    def left(out):
        """Return the coefficients of all runs, and of their parts in each block, effects out."""
        search, base = blocks.search(out), blocks.nested(out)
        whole, parts = [], [[] for _ in range(blocks.count)]
        for i, record in enumerate(fine):
            for p in base:
                if (i, p) not in derivatives:
                    derivatives[i, p] = derivative(p.effect, record)
            values = record.values - output(search, base, [derivatives[i, p] for p in base])
            fold = fold_of(record, blocks.model, blocks.count)
            # a number for each run of windows that touch
            gap = np.diff(record.windows[:, 0], prepend=-np.inf) > 1.5 * record.length
            run = np.cumsum(gap | (np.diff(record.stretch, prepend=-1) != 0))
            for number in np.unique(run):
                rows = run == number
                if rows.sum() >= LEAST_IN_SPECTRUM:
                    whole.append(coefficients(values[rows]))
                for k in range(blocks.count):
                    if (rows & (fold == k)).sum() >= LEAST_IN_SPECTRUM:
                        parts[k].append(coefficients(values[rows & (fold == k)]))
        return whole, parts

    whole, parts = left(frozenset())
    if not whole or not all(parts):
        return None
    window = float(np.median(fine[0].length))
    axes = spectra(whole)
    pairs = []
    for k in range(blocks.count):
        # without an effect every part's search leaves the same
        if blocks.choice().base:
            _, parts = left(frozenset({k}))
        others = [c for j, own in enumerate(parts) if j != k for c in own]
        pairs.append((others, parts[k]))
    return Process(coloured(axes, window), axes, window, *held_out_ratio(pairs, settings))
