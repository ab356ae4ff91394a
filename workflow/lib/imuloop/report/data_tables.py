"""The table of the logs of a device: their size, their clock and their faults."""

from imuloop.report.numbers import (
    NO_NUMBER,
    duration,
    number,
    text_of,
)
from imuloop.report.page import WORDS
from imuloop.report.table import Table

# a figure of quality.json that has one of these texts in each session gets no row
NOTHING = {NO_NUMBER, "none", "0", "1", "not logged", "not known, no full_scale"}


def data_table(device):
    """Return the Table of the logs of a DeviceResults, `device`: a column per session.

    Its rows are the figures of `quality_figures`, such as number of rows, rate and faults. A figure
    that says nothing in all sessions, such as zero gaps, has no row.
    """
    columns = []
    for s in device.sessions:
        status = "rejected" if s.rejected else "used"
        columns.append({"Kind": s.kind, "Status": status} | quality_figures(s.quality))
    # a figure that no session has needs no row
    rows = [(name, *(column[name] for column in columns)) for name in columns[0]]
    return Table(
        "Sessions and the quality of their logs",
        ("Figure, unit", *(session.name for session in device.sessions)),
        [row for row in rows if not NOTHING.issuperset(row[1:])],
    )


def quality_figures(q):
    """Return the figures on the quality of a log as text, a dict by name and unit of the figure.

    `q` is the content of the quality.json of its session.
    """
    jitter, clock, limits = q["jitter"]["std_s"], q["clock"] or {}, q["temperature_range"]
    names = {"roll-overs": "rollovers", "resets": "resets", "strays": "strays"}
    mended = text_of({name: clock.get(key) for name, key in names.items()})
    # saturation is unknown without a full scale
    clipped = {k: v for k, v in q["clipped"].items() if v is not None}
    dropped = WORDS["dropped"].items()
    return {
        "Rows used": text_of(q["rows"]),
        "Duration": duration(q["duration_s"]),
        "Rate, Hz": number(q["rate_hz"], 5),
        "Jitter, 1 σ, ms": number(None if jitter is None else round(jitter * 1e3, 6)),
        "Stamps mended": "rebuilt from the row number" if clock.get("rebuilt") else mended,
        "Clock error by the declared rate, ppm": number(clock.get("drift_ppm")),
        "Clock error by GNSS time, ppm": number((clock.get("pps") or {}).get("drift_ppm")),
        "Gaps": text_of(q["gaps"]["count"]),
        "Length of all gaps, s": number(q["gaps"]["total_s"]),
        **{f"{words}, rows": text_of(q[key]) for key, words in dropped},
        "Clipped, values": text_of(clipped) if clipped else "not known, no full_scale",
        "Constant channels": text_of(q["constant"]),
        **_faults(q["faults"]),
        "Temperature, °C": " to ".join(map(number, limits)) if limits else "not logged",
        "Start": text_of(q["start"]),
        "Units as logged": text_of(q["units"]),
    }


def _faults(quality):
    """Return the faults that ingest found in the samples of a log but left there, a dict of texts.

    A key is the name and unit of the fault. `quality` is the entry ``faults`` of quality.json.
    """

    def rows(key):
        """Return the number of rows with the fault named `key`, by channel, as text."""
        return text_of({k: v["rows"] for k, v in quality.get(key, {}).items()})

    repeats = {sensor: n for sensor, n in (quality.get("rows_a_value") or {}).items() if n > 1}
    rests = quality.get("rests") or {}
    figures = {
        "Zero on all axes, rows": text_of(quality.get("zero_rows")),
        "Stuck at one value, rows": rows("stuck"),
        "Without noise at rest": text_of(quality.get("silent_at_rest")),
        "Spikes of one sample, not removed": text_of(quality.get("spikes")),
        "Clipped at a repeated extreme, rows": rows("clipped_at"),
        "Rows per new value": text_of(repeats) if repeats else "1",
        "Axes that are copies": text_of([f"{b} of {a}" for a, b in quality.get("copies", ())]),
        "Specific force at rest, m/s²": number((rests.get("force") or [None] * 2)[1], 4),
        "Correlation of gyroscope turns with gravity turns (1 is perfect)": number(
            (quality.get("axes") or {}).get("agreement")
        ),
        "Turn by the gyroscope per turn of gravity, rest to rest": number(
            (rests.get("turn_ratio") or {}).get("value")
        ),
    }
    return figures if quality else dict.fromkeys(figures, NO_NUMBER)
