"""Validation by attitude: the error of gravity's direction by each model of a device."""

import pandas as pd

from imuloop.core.files import read_json
from imuloop.report.figures.drawing import BLUE, GREEN, ORANGE, Picture
from imuloop.report.findings import blocks
from imuloop.report.page import phrase

COLOURS = {"raw": GREEN, "base": ORANGE, "final": BLUE}


def attitude_finding(device):
    """Return a text with the result of the validation by attitude.

    The validation gives the error of gravity's direction by each model of the device. Without a
    result the text has the reason; it is empty if the diagnosis already gives the reason. `device`
    is a DeviceResults.
    """
    content = read_json(device.folder / "attitude.json")
    if content["status"] == "ok":
        return phrase("attitude", r=content["methods"]["rotation"])
    told = {block.get("why") for block in blocks(device.diagnosis)}
    return "" if content["why"] in told else phrase("no_attitude", why=content["why"])


def attitude_pictures(device):
    """Return the Picture of the error of gravity's direction in an attitude filter, in a list.

    The filter runs on samples as logged and as calibrated. The list is empty if there is no such
    validation. `device` is a DeviceResults.
    """
    content = read_json(device.folder / "attitude.json")
    if content["status"] != "ok" or "filter" not in content["methods"]:
        return []
    series, filtered = (
        pd.read_parquet(device.folder / "attitude.parquet"),
        content["methods"]["filter"],
    )
    of_method = series[series["method"] == "filter"]
    # the clocks of sessions have different zeros: only the session with the most rows is drawn
    longest = of_method["session"].astype(str).value_counts(sort=False).sort_index().idxmax()
    rows = of_method[of_method["session"] == longest].drop(columns="method")
    words = {"raw": "as logged", "base": "base model", "final": "final model"}
    if filtered["models"]["base"] == filtered["models"]["final"]:
        words = {"raw": "as logged", "final": "base model, also the final one"}

    def plot(area):
        """Draw the error of each model over time on the Axes `area`, a line for each stretch.

        A stretch is a part of the log, from a rest to a later rest, that the model was not fitted
        to.
        """
        for model, text in words.items():
            for _, r in rows[rows["model"] == model].groupby("stretch"):
                looks = {"color": COLOURS[model], "ms": 3, "label": text}
                area.semilogy(r["t_s"], r["error_deg"], "-o", **looks)
        area.set_xlabel("time, s")
        area.set_ylabel("error of the vertical, °")

    caption = phrase("filter", filtered=filtered, words=words)
    name = f"{device.name}.attitude_filter"
    return [Picture(name, "Error of the vertical", caption, plot, rows)]
