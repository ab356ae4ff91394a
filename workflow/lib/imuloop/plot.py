"""The figures of a device: those of the report, of its files and of notebooks, by matplotlib.

``draw(areas, result, name)`` draws one of them on Axes; ``result.plot.allan()`` gives figures.
"""

from imuloop.core.errors import ImuloopError
from imuloop.report.pictures import KINDS, pictures
from imuloop.report.results import read_device


def draw(areas, result, name):
    """Draw a figure of a result.

    Parameters
    ----------
    areas : matplotlib.axes.Axes, or list of them
        Where to draw; a figure of several areas needs as many, row by row.
    result : imuloop.Result
        What was found out about a device.
    name : str
        That of the figure's file, as ``static_1_allan_gyroscope``.

    Raises
    ------
    ImuloopError
        If there is no figure of that name; says which there are.
    """
    known = {p.stem: p for kind in KINDS for p in result.plot.pictures(kind)}
    if name not in known:
        raise ImuloopError(f"{name}: no figure has this name; there are {', '.join(known)}")
    known[name].plot(areas)


class Plots:
    """Figures of a result by kind: ``plots.allan()``, ``plots.residuals("accelerometer")``.

    Each of `KINDS` is a function that returns matplotlib figures, of those whose name has the words
    that it is given.
    """

    def __init__(self, device):
        folder, label = device.folder, device.label or device.name
        device.file("figures").mkdir(exist_ok=True)
        self._device = read_device(device.name, label, folder, device.kinds)

    def pictures(self, kind):
        """Return the `Picture` objects of one of `KINDS`."""
        return pictures(self._device, kind)

    def __getattr__(self, kind):
        if kind not in KINDS:
            raise AttributeError(f"no figures of this kind, {kind}; there are {', '.join(KINDS)}")
        return lambda *words: [
            p.figure() for p in self.pictures(kind) if all(word in p.stem for word in words)
        ]

    def __dir__(self):
        return [*super().__dir__(), *KINDS]
