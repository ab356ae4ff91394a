"""Validation by attitude: the error of gravity's direction that a user of each model meets."""

import pandas as pd

from imuloop.core.errors import plural
from imuloop.core.files import read_json
from imuloop.report.figures.drawing import BLUE, GREEN, ORANGE, drawn
from imuloop.report.numbers import duration, interval_text, number, with_unit
from imuloop.report.verdict import blocks

MODELS = {"raw": "as logged", "base": "base model", "final": "final"}
COLOURS = {"raw": GREEN, "base": ORANGE, "final": BLUE}


def attitude_part(device):
    """Return finding and pictures of the validation by attitude, empty without one."""
    content = read_json(device.folder / "attitude.json")
    if content["status"] != "ok":
        told = {block.get("why") for *_, block in blocks(device.diagnosis)}
        finding = f"The error of the vertical cannot be tested: {content['why']}."
        finding = "" if content["why"] in told else finding
        return {"finding": finding, "pictures": []}
    series = pd.read_parquet(device.folder / "attitude.parquet")
    return {
        "finding": _finding(content["methods"]["rotation"]),
        "pictures": [_picture(device, content["methods"]["filter"], series)]
        if "filter" in content["methods"]
        else [],
    }


def _degrees(value):
    return with_unit(number(value, 2), "°")


def _finding(rotation):
    """Return what the validation found, in a sentence."""
    raw, base, final = (_degrees(rotation["models"][m]["rms_deg"]) for m in MODELS)
    found = (
        f"Over one rotation of {duration(rotation['duration_s'], 2)} the gyroscope alone puts the "
        f"vertical off by {raw} as logged, {base} with the base model"
    )
    if rotation["base_over_final"] == 1:
        return f"{found}; the final model is the same."
    return (
        f"{found}, {final} with the final one (root mean square, held out); base over final "
        f"{number(rotation['base_over_final'])}, 95 % interval "
        f"{interval_text(rotation['ratio_ci95'])}. The noise alone gives "
        f"{_degrees(rotation['floor_deg'])}."
    )


def _picture(device, filtered, series):
    of_method = series[series["method"] == "filter"]
    # clocks of sessions do not share a zero: the one with the most is drawn
    longest = of_method["session"].astype(str).value_counts(sort=False).sort_index().idxmax()
    shown = of_method[of_method["session"] == longest].drop(columns="method")
    of, words = filtered["models"], dict(MODELS)
    if of["base"] == of["final"]:
        words = {"raw": MODELS["raw"], "final": f"{MODELS['base']}, also the final one"}

    def plot(area):
        for model, text in words.items():
            for _, r in shown[shown["model"] == model].groupby("stretch"):
                looks = {"color": COLOURS[model], "ms": 3, "label": text}
                area.semilogy(r["t_s"], r["error_deg"], "-o", **looks)
        area.set_xlabel("time, s")
        area.set_ylabel("error of the vertical, °")

    errors = ", ".join(f"{_degrees(of[m]['rms_deg'])} {text}" for m, text in words.items())
    caption = (
        f"Filter VQF without magnetometer: error when a turn is over {errors} "
        f"({plural(filtered['n'], 'case')})."
    )
    size, kind = (440, 270), "Error of the vertical"
    return drawn(device, "attitude_filter", kind, caption, plot, shown, size=size)
