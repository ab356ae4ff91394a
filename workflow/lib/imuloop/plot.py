"""The figures of the report on a device, for notebooks: ``result.plot.allan()`` returns them."""

from functools import partial

from imuloop.core.errors import ImuloopError, nearest
from imuloop.core.samples import SENSORS
from imuloop.report.pictures import KINDS, pictures
from imuloop.report.results import read_device


class Plots:
    """Figures of a result: each method, such as ``plots.residuals()``, returns a list of them.

    A figure is one of matplotlib. The arguments of a method are names of sensors, sessions or
    figures: only figures whose names contain all of these names are drawn, and without arguments
    all are. A name that no figure has raises an ImuloopError. The methods draw:

    - `loop`: errors as logged, calibrated and with the effects corrected.
    - `poses`: attitudes in which the device rested.
    - `attitude`: error of gravity's direction in stretches of a log to which no model was fitted.
    - `series`: samples of each session, with its rests.
    - `allan`: Allan deviation of each session, with its model.
    - `spectra`: power spectral density of each session.
    - `residuals`: held-out errors of poses, moves and windows with a reference.
    - `bias`: bias over time at rest.
    - `temperature`: bias at rest against the temperature, with the fitted curve.
    - `corrected`: Allan deviation as logged and with the effects removed.
    """

    def __init__(self, device):
        device.file("figures").mkdir(exist_ok=True)
        self._device = read_device(device)

    def pictures(self, kind):
        """Return the Pictures of one kind, a list, from which figures are drawn.

        `kind` is one of `KINDS`, the names of the methods.
        """
        return pictures(self._device, kind)

    def __getattr__(self, kind):
        if kind in KINDS:
            return partial(self._figures, kind)
        raise AttributeError(
            f"no figures of this kind, {kind}; there are {', '.join(KINDS)}", name=kind, obj=self
        )

    def __dir__(self):
        return [*super().__dir__(), *KINDS]

    def _figures(self, kind, *names):
        """Return the figures of one kind whose names contain all of `names`, a list.

        `kind` is one of `KINDS`, such as ``allan``. Raises an ImuloopError for a name that no
        figure has.
        """
        drawn = {p.stem: p for p in self.pictures(kind)}
        places = [*SENSORS, *(s.name for s in self._device.sessions), *drawn]
        for name in names:
            if not any(_holds(place, name) for place in places):
                raise ImuloopError(
                    f"{kind}: '{name}' names no figure{nearest(str(name), places, 0.5)}"
                )
        return [p.figure() for stem, p in drawn.items() if all(_holds(stem, n) for n in names)]


def _holds(stem, name):
    """Return whether the name of a figure, `stem`, contains the text `name` as whole words."""
    return f"_{name}_" in f"_{stem}_"
