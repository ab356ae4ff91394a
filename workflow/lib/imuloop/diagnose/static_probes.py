"""What the residual of static records goes with: probes that tell a person where to look."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.memory import in_pieces
from imuloop.effects.axes import on_each_axis


@dataclass(frozen=True)
class Probe:
    """A pattern by name, with parameters of its own on each axis.

    Attributes
    ----------
    name : {'time', 'temperature', 'temperature_rate', 'pose_variance'}
        What it is made of.
    """

    name: str

    def design(self, channels):
        """Return its columns on each axis, shape (n, 3, 3 c)."""
        if self.name == "time":
            t = channels.t / np.ptp(channels.t)
            return on_each_axis(t, t**2)
        if self.name == "temperature":
            return on_each_axis(channels.temperature, channels.temperature**2)
        if self.name == "temperature_rate":
            return on_each_axis(np.gradient(channels.temperature, channels.t))
        mean, square = np.split(channels.remembered(_moments), 2, axis=1)
        return on_each_axis(square - mean**2)


@in_pieces
def _moments(channels):
    """Return the output of each axis and its square, shape (n, 6)."""
    values = channels.output
    # about a mean, so that the difference of squares keeps its digits
    centre = {} if channels.past is None else channels.past
    values = values - centre.setdefault("mean", values.mean(axis=0))
    return np.hstack([values, values**2])


def static_correlates(search, base):
    """Return what share of the residual each probe takes, the most telling first.

    ``share = 1 - (S₁/ν₁)/(S₀/ν₀)`` of the sum of squares of all axes, not below 0, with the
    p-value of the test that effects have.

    Returns
    -------
    list of dict
        ``name``, ``residual``, ``columns``, ``share``, ``p_value``.
    """
    names = ["time", "pose_variance"]
    if all(r.channels.temperature is not None for r in search.sight.model.records):
        names += ["temperature", "temperature_rate"]
    found = []
    for name in names:
        (pattern,) = search.sight.model.patterns((Probe(name),))
        trial = search.test(base, pattern)
        if trial is None:
            continue
        squares, columns = np.zeros(2), 0
        for axis in range(3):
            if pattern.columns[axis]:
                fits = search.fit(base, axis), search.fit((*base, pattern), axis)
                # point 0 of the grid is white noise
                squares += [f.square[0] / f.dof for f in fits]
                columns += len(pattern.columns[axis])
        found.append(
            {
                "name": name,
                "residual": "bias",
                "columns": columns,
                "share": float(np.clip(1 - squares[1] / squares[0], 0, 1)),
                "p_value": trial.p_value,
            }
        )
    return sorted(found, key=lambda c: (c["p_value"], -c["share"]))
