"""Control charts of a type: each device's value over its place in the production."""

from datetime import date

import numpy as np
import pandas as pd
from matplotlib.ticker import FuncFormatter, MaxNLocator

from imuloop.report.figures.drawing import BLUE, INK, VERMILLION, Picture, entitle, write_csv
from imuloop.report.numbers import number
from imuloop.report.tables.family import kinds, outside_limits

# the fewest devices that make a chart, and the most whose own intervals can be told apart
FEWEST, MOST = 5, 60
# the most that a caption names
NAMED = 3
# of each device in family.json
COLUMNS = ("values", "std", "lower_limits", "upper_limits")


def control_charts(name, found, labels, folder):
    """Return a picture for each kind of parameter of a type, with an area for each axis.

    Takes the name of the type, its content of family.json, the labels of the devices by name, and
    the folder that the numbers are written into. None where there are too few devices.
    """
    places = production(found, labels)
    if len(places) < FEWEST:
        return []
    charts = []
    for kind in kinds():
        shown = {
            a: found["parameters"][p] for p, a in kind.axes.items() if p in found["parameters"]
        }
        if shown:
            charts.append(_chart(name, kind, shown, places, labels, folder))
    return charts


def production(found, labels):
    """Return what is written below each device, in the order of the production.

    By serial number or, where not all have one, by date, else in the order of the config.
    """
    names, order = found["devices"], found["order"]
    written = {
        "serial": "{:.12g}".format,
        "date": lambda ordinal: date.fromordinal(int(ordinal)).isoformat(),
    }
    for key, text in written.items():
        if all(order[n][key] is not None for n in names):
            return {n: text(order[n][key]) for n in sorted(names, key=lambda n: order[n][key])}
    return {n: labels[n] for n in names}


def _chart(name, kind, shown, places, labels, folder):
    # of each axis the devices in the order of the production
    tables = []
    for axis, one in shown.items():
        place = {device: k for k, device in enumerate(places)}
        table = pd.DataFrame({key: one[key] for key in ("devices", *COLUMNS)})
        table["outside"] = table.index.isin(outside_limits(one))
        for key, reach in (("low", -1.96 * table["std"]), ("high", 1.96 * table["std"])):
            values = table["values"]
            table[key] = values * np.exp(reach) if kind.relative else values + reach
        table = table.assign(axis=axis, place=table["devices"].map(place))
        tables.append(table.sort_values("place"))
    whole = pd.concat(tables)
    lengths = [*COLUMNS[:1], *COLUMNS[2:], "low", "high"]
    unit, factor = kind.display.unit, kind.display.factor
    stem = f"type_{name}_{kind.sensor}_{kind.words.replace(' ', '_')}"
    numbers = {"device": whole["devices"], "place": whole["devices"].map(places)}
    numbers |= {"axis": whole["axis"]} | {f"{key}_{unit}": whole[key] * factor for key in lengths}
    write_csv(folder, stem, numbers)

    def plot(areas):
        for area, table in zip(np.atleast_1d(areas), tables, strict=True):
            x, y = table["place"].to_numpy(), table["values"].to_numpy() * factor
            area.axhline(shown[table["axis"].iloc[0]]["mean"] * factor, color=INK, lw=0.8)
            for key in ("lower_limits", "upper_limits"):
                limit = {"color": INK, "lw": 0.8, "ls": "--", "drawstyle": "steps-mid"}
                area.plot(x, table[key] * factor, **limit)
            if len(table) <= MOST:
                area.vlines(x, table["low"] * factor, table["high"] * factor, color=BLUE, lw=1)
                area.plot(x, y, "o", color=BLUE, ms=3)
            else:
                area.plot(x, y, color=BLUE, lw=0.8)
            out = table["outside"].to_numpy()
            if out.any():
                (marks,) = area.plot(x[out], y[out], "o", color=VERMILLION, ms=5)
                said = zip(table["devices"][out], y[out], strict=True)
                entitle(area, marks, [f"{labels[device]} {number(v)}" for device, v in said])
            area.set_ylabel(f"{table['axis'].iloc[0]}, {unit}")
            area.xaxis.set_major_locator(MaxNLocator(5, integer=True))
            below = [*places.values()]
            area.xaxis.set_major_formatter(FuncFormatter(lambda k, _, b=below: _below(b, k)))

    looks = {"size": (440, 30 + 105 * len(tables)), "rows": (1,) * len(tables)}
    looks["csv"] = f"{folder.name}/{stem}.csv"
    caption = _caption(kind, shown, whole, labels)
    return Picture(f"all.{stem}", "Control chart", caption, plot, **looks)


def _caption(kind, shown, whole, labels):
    """Return who is outside of the limits, and the spread between devices."""
    out = whole[whole["outside"]]
    caption = f"{kind.title.capitalize()}, {kind.display.unit}: "
    if len(out):
        named = [f"{labels[d]} {a}" for d, a in zip(out["devices"], out["axis"], strict=True)]
        more = ", …" if len(named) > NAMED else ""
        caption += f"{len(out)} of {len(whole)} values outside the limits, "
        caption += f"{', '.join(named[:NAMED])}{more}; between devices "
    else:
        caption += f"all {len(whole)} values within the limits; between devices "
    relative = "\u202f%" if kind.relative else ""
    spreads = (f"{axis} {kind.spread(one['spread'])}{relative}" for axis, one in shown.items())
    return f"{caption}{', '.join(spreads)}."


def _below(texts, k):
    """Return what stands below a place of the axis."""
    text = texts[int(k)] if k == int(k) and 0 <= k < len(texts) else ""
    return text if len(text) <= 10 else f"{text[:9]}…"
