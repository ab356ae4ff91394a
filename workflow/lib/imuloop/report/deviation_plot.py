"""The deviations that were asked for beside Allan's, each by its name, a panel an axis."""

from itertools import cycle

import numpy as np

from imuloop.report.allan_plot import curve
from imuloop.report.columns import rows
from imuloop.report.numbers import number, with_unit
from imuloop.report.results import SENSORS, UNITS, XYZ
from imuloop.report.spectrum_plot import view
from imuloop.report.svg import INK, PALETTE, Picture, draw, write_csv

# views that have pictures of their own
SPECTRA = ("psd", "autocorrelation")
NOTE = "Different definitions: never compare one with another, nor its lowest part with B."


def deviation_pictures(device, session, folder):
    """Return the deviations of a session that were asked for, a picture a sensor.

    Parameters
    ----------
    device : Device
        The device.
    session : Session
        A session; no picture where its views hold no such deviation.
    folder : Path
        Where the CSV files go.
    """
    names = [] if session.views is None else list(dict.fromkeys(session.views["view"]))
    found = {n: view(session, n) for n in names if n not in SPECTRA}
    if not found:
        return []
    called = {"view": "definition", "x": "tau_s", "value": "deviation"}
    table = {
        called.get(name, name): np.concatenate([r[name] for r in found.values()])
        for name in session.views
    }
    csv = write_csv(folder, f"{session.name}_deviations", table)
    return [_picture(device, session, sensor, found, csv) for sensor in SENSORS]


def _label(name):
    # loads for half a second, and few ask for these deviations
    from imuloop.noise.views import label

    return label(name)


def words(name):
    """Return how a deviation is called: the part of its label before what it means."""
    short = _label(name).partition(" deviation")[0]
    return short.replace("M-", f"{name.rpartition('_')[2]}-")


def _picture(device, session, sensor, found, csv):
    def plot(panels):
        for ax, axis, channel in zip(panels, XYZ, SENSORS[sensor], strict=True):
            handles, labels = [], []
            if session.allan is not None:
                allan = curve(session.allan, channel, "raw")
                handles += ax.loglog(allan["tau_s"], allan["adev"], color=INK, lw=1)
                labels.append("Allan")
            for colour, (name, table) in zip(cycle(PALETTE), found.items(), strict=False):
                r = rows(table, table["axis"] == channel)
                handles += ax.loglog(r["x"], r["value"], color=colour)
                ax.fill_between(r["x"], r["ci_low"], r["ci_high"], color=colour, alpha=0.1)
                labels.append(words(name))
            ax.set_xlabel(f"{axis}: averaging time τ, s")
        panels[0].set_ylabel(f"deviation, {UNITS[sensor]}")
        panels[-1].legend(handles, labels, beside=True)

    caption = f"{session.name}, {sensor}: {_finding(session, sensor, found)}."
    name = f"{device.name}.{session.name}.deviations_{sensor}"
    svg = draw(
        name,
        f"Deviations of several definitions, {caption}",
        1000,
        300,
        plot,
        margins=(58, 130, 12, 40),
        columns=(1, 1, 1),
        sharey=True,
    )
    note = " ".join([NOTE, *(f"{_label(n)}." for n in found)])
    return Picture(name, svg, caption, note, (csv,), wide=True)


def _finding(session, sensor, found):
    """Return the lowest value of each definition, of the worst axis."""
    told = []
    if session.allan is not None:
        curves = {c: curve(session.allan, c, "raw")["adev"] for c in SENSORS[sensor]}
        told += _low("Allan", curves, sensor)
    for name, r in found.items():
        curves = {c: r["value"][r["axis"] == c] for c in SENSORS[sensor]}
        told += _low(words(name), curves, sensor)
    return f"lowest part, by definition, of the axis where it is highest: {'; '.join(told)}"


def _low(words, curves, sensor):
    """Return the lowest value of the axis where it is highest, in words; none without any."""
    lows = [(values.min(), channel[-1]) for channel, values in curves.items() if len(values)]
    if not lows:
        return []
    low, axis = max(lows)
    return [f"{words} {with_unit(number(low), UNITS[sensor])} ({axis})"]
