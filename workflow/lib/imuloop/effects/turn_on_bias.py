"""A bias that differs each time the device is switched on."""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis


@dataclass(frozen=True)
class TurnOnBias(Effect):
    """``e_i = s_ki`` in run k, ``Σ_k s_ki = 0``: each of several runs has a bias of its own.

    A run is a session, or what follows a gap longer than all that was recorded before. The bias of
    the calibration is the mean over the runs; in a log of a run that it does not know the effect is
    zero. Leaves: levels of the pose means that change from run to run and in no other way.
    Imitated by: whatever differs between the runs as a whole, temperature above all.
    """

    runs: int = 2

    name = "turn_on_bias"
    equation = "e_i = s_ki in run k, Σ_k s_ki = 0"
    reference = "IEEE Std 1554-2005, bias repeatability"
    needs = ("run",)
    records = ("poses",)
    bounds = {"runs": (2, 50)}

    @property
    def parameters(self):
        """Names and units, all axes of the second run first; the first has less their sum."""
        return per_axis({f"s{k}": "output" for k in range(2, self.runs + 1)})

    @classmethod
    def shapes(cls, channels):
        """Return the one shape for these runs."""
        return (cls(int(channels.run.max()) + 1),)

    def design(self, channels):
        """Return which run each point is in, against the first, shape (n, 3, 3 (runs - 1))."""
        if channels.run is None:
            return np.zeros((len(channels.t), 3, 3 * (self.runs - 1)))
        first = (channels.run == 0).astype(float)
        return on_each_axis(*((channels.run == k) - first for k in range(1, self.runs)))

    def run_to_run(self, values):
        """Return the run-to-run standard deviation of each axis, and its 95 % interval, (2, 3).

        By χ² with one degree of freedom less than there are runs. Takes the parameters by name, SI.
        """
        others = np.array([values[name] for name in self.parameters]).reshape(-1, 3)
        std = np.vstack([-others.sum(axis=0), others]).std(axis=0, ddof=1)
        dof = self.runs - 1
        return std, np.outer(np.sqrt(dof / chdtri(dof, [0.025, 0.975])), std)
