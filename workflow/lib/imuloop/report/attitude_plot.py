"""Validation by attitude: the error of gravity's direction that a user of each model meets."""

from imuloop.core.files import read_json
from imuloop.core.samples import read_columns
from imuloop.report.columns import groups, rows
from imuloop.report.numbers import duration, interval_text, number, plural, with_unit
from imuloop.report.svg import BLUE, GREEN, ORANGE, Picture, draw, write_csv
from imuloop.report.table import Table

MODELS = {"raw": "as logged", "base": "base model", "final": "final"}
_LOOKS = {
    "raw": {"color": GREEN, "ms": 3},
    "base": {"color": ORANGE, "ms": 3},
    "final": {"color": BLUE, "ms": 3},
}
_METHODS = {
    "rotation": "gyroscope alone, from a rest to the next",
    "stretch": "gyroscope alone, through a held-out stretch",
    "mahony": "Mahony filter, arriving at a rest",
}
_FIGURES = {
    "stretch": "Gyroscope alone from the first rest of each stretch on",
    "mahony": "Mahony filter with gains of {k_P:g} 1/s and {k_I:g} 1/s²",
}
NOTE = (
    "How far the computed vertical is off at the rests, where the accelerometer tells it. Each "
    "line is a stretch of rotations that no model has seen, and effects were chosen without it."
)


def attitude_part(device, folder):
    """Return finding, table and pictures of the validation by attitude, empty without one.

    Parameters
    ----------
    device : Device
        The device.
    folder : Path
        Where the CSV files go.
    """
    path = device.folder / "attitude.json"
    content = read_json(path) if path.exists() else {}
    if content.get("status") != "ok":
        return {"finding": _nothing(content), "tables": [], "pictures": []}
    series = read_columns(path.with_suffix(".parquet"))
    return {
        "finding": _finding(content["methods"]["rotation"]),
        "tables": [_table(content["methods"])],
        "pictures": [_picture(device, content, series, method, folder) for method in _FIGURES],
    }


def _nothing(content):
    why = content.get("why")
    return f"The error of the vertical cannot be tested: {why}." if why else ""


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
    for method, words in _METHODS.items():
        m = methods[method]
        rows.append(
            (
                words,
                str(m["n"]),
                duration(m["duration_s"], 2),
                *(
                    f"{number(m['models'][model]['rms_deg'], 2)} "
                    f"({number(m['models'][model]['p95_deg'], 2)})"
                    for model in MODELS
                ),
                number(m["base_over_final"]),
                interval_text(m["ratio_ci95"]),
            )
        )
    return Table(
        "Error of the vertical on held-out stretches, °: root mean square (95 % quantile)",
        (
            *("Carried by", "Count", "Time, median"),
            *(f"{words[0].upper()}{words[1:]}, °" for words in MODELS.values()),
            *("Base over final", "95 % interval"),
        ),
        tuple(rows),
        "As logged: with the scale of the data sheet. Base: bias, scale factor and misalignment of "
        "both sensors. Final: with the effects that the diagnosis added. The filter follows the "
        "accelerations of a turn too, which no calibration takes away.",
    )


def _picture(device, content, series, method, folder):
    # clocks of sessions do not share a zero: the one with the most is drawn
    sessions = groups(series["session"])
    of_method = series["method"] == method
    session = max(sessions, key=lambda name: (of_method & sessions[name]).sum())
    shown = rows(series, of_method & sessions[session])
    identity = f"{device.name}.attitude_{method}"
    columns = {name: values for name, values in shown.items() if name != "method"}
    csv = write_csv(folder, f"attitude_{method}", columns)

    of = content["methods"][method]["models"]
    words = dict(MODELS)
    if of["base"] == of["final"]:
        words = {"raw": MODELS["raw"], "final": f"{MODELS['base']}, also the final one"}

    def plot(ax):
        handles = []
        for model in words:
            of_model = rows(shown, shown["model"] == model)
            t, error = of_model["t_s"], of_model["error_deg"]
            stretches = groups(of_model["stretch"]).values()
            drawn = [ax.plot(t[at], error[at], "-o", **_LOOKS[model]) for at in stretches]
            handles += drawn[0]
        ax.set_yscale("log")
        ax.set_xlabel("time, s")
        ax.set_ylabel("error of the vertical, °")
        ax.legend(handles, list(words.values()))

    errors = ", ".join(f"{_degrees(of[m]['rms_deg'])} {text}" for m, text in words.items())
    when = "at the end of a stretch" if method == "stretch" else "when a turn is over"
    caption = (
        f"{_FIGURES[method].format(**content['gains'])}: error {when} {errors} "
        f"({plural(content['methods'][method]['n'], 'case')})."
    )
    svg = draw(identity, f"Error of the vertical. {caption}", 440, 270, plot, (58, 12, 28, 42))
    return Picture(identity, svg, caption, NOTE, (csv,))
