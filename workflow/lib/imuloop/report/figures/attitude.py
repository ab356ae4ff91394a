"""Validation by attitude: the error of gravity's direction that a user of each model meets."""

import pandas as pd

from imuloop.core.files import read_json
from imuloop.report.figures.drawing import BLUE, GREEN, ORANGE, picture, write_csv
from imuloop.report.numbers import duration, interval_text, number, plural, with_unit
from imuloop.report.tables.table import Table

MODELS = {"raw": "as logged", "base": "base model", "final": "final"}
COLOURS = {"raw": GREEN, "base": ORANGE, "final": BLUE}
METHODS = {
    "rotation": "gyroscope alone, from a rest to the next",
    "stretch": "gyroscope alone, through a held-out stretch",
    "mahony": "Mahony filter, arriving at a rest",
}
FIGURES = {
    "stretch": "Gyroscope alone from the first rest of each stretch on",
    "mahony": "Mahony filter with gains of {k_P:g} 1/s and {k_I:g} 1/s²",
}


def attitude_part(device):
    """Return finding, tables and pictures of the validation by attitude, empty without one."""
    path = device.folder / "attitude.json"
    content = read_json(path) if path.exists() else {}
    if content.get("status") != "ok":
        why = content.get("why")
        finding = f"The error of the vertical cannot be tested: {why}." if why else ""
        return {"finding": finding, "tables": [], "pictures": []}
    series = pd.read_parquet(path.with_suffix(".parquet"))
    return {
        "finding": _finding(content["methods"]["rotation"]),
        "tables": [_table(content["methods"])],
        "pictures": [_picture(device, content, series, method) for method in FIGURES],
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


def _table(methods):
    rows = []
    for method, words in METHODS.items():
        m = methods[method]
        errors = [
            f"{number(m['models'][model]['rms_deg'], 2)} "
            f"({number(m['models'][model]['p95_deg'], 2)})"
            for model in MODELS
        ]
        ratio = (number(m["base_over_final"]), interval_text(m["ratio_ci95"]))
        rows.append((words, str(m["n"]), duration(m["duration_s"], 2), *errors, *ratio))
    heads = [f"{words[0].upper()}{words[1:]}, °" for words in MODELS.values()]
    return Table(
        "Error of the vertical on held-out stretches, °: root mean square (95 % quantile)",
        ("Carried by", "Count", "Time, median", *heads, "Base over final", "95 % interval"),
        rows,
        "As logged: with the scale of the data sheet. Base: bias, scale factor and misalignment of "
        "both sensors. Final: with the effects that the diagnosis added. The filter follows the "
        "accelerations of a turn too, which no calibration takes away.",
    )


def draw_attitude(area, series, words):
    """Draw the error of the vertical over time, a line per stretch, for each model of `words`."""
    handles = []
    for model in words:
        for _, r in series[series["model"] == model].groupby("stretch"):
            line = area.semilogy(r["t_s"], r["error_deg"], "-o", color=COLOURS[model], ms=3)
        handles += line
    area.set_xlabel("time, s")
    area.set_ylabel("error of the vertical, °")
    return handles, list(words.values())


def _picture(device, content, series, method):
    of_method = series[series["method"] == method]
    # clocks of sessions do not share a zero: the one with the most is drawn
    longest = of_method["session"].astype(str).value_counts(sort=False).sort_index().idxmax()
    shown = of_method[of_method["session"] == longest].drop(columns="method")
    of, words = content["methods"][method]["models"], dict(MODELS)
    if of["base"] == of["final"]:
        words = {"raw": MODELS["raw"], "final": f"{MODELS['base']}, also the final one"}
    errors = ", ".join(f"{_degrees(of[m]['rms_deg'])} {text}" for m, text in words.items())
    caption = (
        f"{FIGURES[method].format(**content['gains'])}: error "
        f"{'at the end of a stretch' if method == 'stretch' else 'when a turn is over'} {errors} "
        f"({plural(content['methods'][method]['n'], 'case')})."
    )
    return picture(
        f"{device.name}.attitude_{method}",
        "Error of the vertical",
        caption,
        lambda area: draw_attitude(area, shown, words),
        (440, 270),
        write_csv(device.figures, f"attitude_{method}", shown),
    )
