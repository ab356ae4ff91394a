"""The figures of a device in notebooks, by matplotlib; they are those of the report.

``draw(areas, result, name)`` draws a figure on given Axes; ``result.plot.allan()`` returns figures.
"""

from imuloop.core.errors import ImuloopError, nearest
from imuloop.core.samples import SENSORS
from imuloop.report.pictures import KINDS, pictures
from imuloop.report.results import read_device

# the first line of the help on each kind
WORDS = {
    "loop": "Draw the errors as logged, calibrated and with the effects corrected.",
    "poses": "Draw the attitudes that were covered.",
    "attitude": "Draw the error of the vertical on stretches that no model has seen.",
    "series": "Draw the samples of each session, with the stretches taken as rest.",
    "allan": "Draw the Allan deviation of each session, with its model.",
    "spectra": "Draw the power spectral density of each session.",
    "residuals": "Draw the held-out residuals of poses, moves and reference.",
    "bias": "Draw the bias over time at rest.",
    "temperature": "Draw the bias at rest against the temperature, with the fitted curve.",
    "corrected": "Draw the Allan deviation as logged and with the effects removed.",
}


def draw(areas, result, name):
    """Draw a figure of a result.

    Parameters
    ----------
    areas : matplotlib.axes.Axes, or list of them
        Where to draw; a figure of several areas needs as many, row by row.
    result : imuloop.Result
        The result of a device.
    name : str
        Name of the figure's file, as ``static_1_allan_gyroscope``.

    Raises
    ------
    ImuloopError
        If no figure has that name; the message lists the names.
    """
    known = {p.stem: p for kind in KINDS for p in result.plot.pictures(kind)}
    if name not in known:
        raise ImuloopError(f"{name}: no figure has this name; there are {', '.join(known)}")
    known[name].plot(areas)


class Plots:
    """Figures of a result: each method, such as ``plots.residuals()``, returns a list of them."""

    def __init__(self, device):
        folder, label = device.folder, device.label or device.name
        device.file("figures").mkdir(exist_ok=True)
        self._device = read_device(device.name, label, folder, device.kinds)

    def pictures(self, kind):
        """Return the `Picture` objects of one of `KINDS`."""
        return pictures(self._device, kind)

    def _figures(self, kind, names):
        """Return the figures of a kind, a list, whose names contain all of `names`."""
        drawn = {p.stem: p for p in self.pictures(kind)}
        known = [*SENSORS, *(s.name for s in self._device.sessions), *drawn]
        for name in names:
            if not any(_holds(each, name) for each in known):
                raise ImuloopError(
                    f"{kind}: '{name}' names no figure{nearest(str(name), known, 0.5)}"
                )
        return [p.figure() for stem, p in drawn.items() if all(_holds(stem, n) for n in names)]

    def __getattr__(self, kind):
        raise AttributeError(
            f"no figures of this kind, {kind}; there are {', '.join(KINDS)}", name=kind, obj=self
        )


def _holds(stem, name):
    """Return whether the name of a figure, `stem`, contains `name` as whole words."""
    return f"_{name}_" in f"_{stem}_"


def _method(kind, words):
    """Return the method of `Plots` that draws the figures of a kind.

    `words` is the first line of its docstring.
    """

    def figures(self, *names):
        return self._figures(kind, names)

    figures.__name__, figures.__qualname__ = kind, f"{Plots.__name__}.{kind}"
    figures.__doc__ = f"""{words}

    Parameters
    ----------
    *names : str
        Return only figures whose names contain these: a sensor, a session, or a figure's own name.

    Returns
    -------
    list of matplotlib.figure.Figure

    Raises
    ------
    ImuloopError
        If no figure has such a name.
    """
    return figures


for _kind, _words in WORDS.items():
    setattr(Plots, _kind, _method(_kind, _words))
