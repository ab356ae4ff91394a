"""Static records of known noise, made window by window."""

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.diagnose.static_means import StaticRecord
from imuloop.diagnose.static_problem import StaticProblem
from imuloop.estimate.search import Search
from imuloop.model.effect import Channels

LENGTH = 60.0


def windows(n):
    start = LENGTH * np.arange(n)
    return np.column_stack([start, start + LENGTH])


def temperature(n):
    """Return degC that falls, rests, rises and falls again."""
    u = (np.arange(n) + 0.5) / n
    return 20 + 15 * np.interp(u, [0, 0.3, 0.4, 0.8, 1], [0.5, -1, -1, 1, 0.4])


def root(n, flicker=0.0, walk=0.0):
    """Return a root of the covariance of n means for N = 1.

    `flicker`, `walk` are the variances of their slowest modes relative to white noise.
    """
    span = n * LENGTH
    parts = (1.0, "N"), (flicker * np.pi / span, "B"), (walk * (np.pi / span) ** 2, "K")
    covariance = sum(
        f * AxisNoise(**{name: Coefficient(1.0)}).mean_covariance(windows(n)) for f, name in parts
    )
    return np.linalg.cholesky(covariance)


def record(values, session="s", warm=True, stretch=None):
    n = len(values)
    t = windows(n).mean(axis=1)
    warmth = temperature(n) if warm else None
    whole = Channels(t, np.tile([0.1, -0.2, 9.8], (n, 1)), np.zeros((n, 3)), warmth)
    channels = Channels(
        *(whole.t, whole.output, whole.other, warmth), lambda function, *c: function(whole, *c)
    )
    stretch = np.zeros(n, dtype=int) if stretch is None else stretch
    return StaticRecord(session, windows(n), stretch, values, channels)


def search(records, effects, tests=20, held_out=frozenset()):
    """Return a search for variants of effects in records that does not see some parts."""
    variants = {}
    for effect in effects:
        variants.setdefault(type(effect), []).append(effect)
    variants = {cls: tuple(effects_of_kind) for cls, effects_of_kind in variants.items()}
    return Search(StaticProblem(tuple(records), variants, DiagnoseSettings(), tests), held_out)
