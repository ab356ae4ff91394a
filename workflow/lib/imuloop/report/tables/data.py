"""What was recorded: sessions, quality, source, and what the segmentation made of them."""

from imuloop.report.numbers import NO_NUMBER, duration, number, text_of
from imuloop.report.tables.table import Table

# what a figure is where there is nothing to say
NOTHING = {NO_NUMBER, "none", "0", "1", "not logged", "not known, no full_scale"}
# rows that ingest drops, by the reason it counts them under
DROPPED = {
    "duplicates": "Repeated stamps",
    "identical": "Identical to the row before",
    "out_of_order": "Out of order",
    "non_finite": "Non-finite",
    "bad_lines": "Unreadable",
    "spiked": "With a spike of one sample",
    "outside_time_range": "Outside the time range",
}
# what is mended in stamps, as quality.json counts it
MENDED = {"roll-overs": "rollovers", "resets": "resets", "strays": "strays"}


def data_table(device):
    """Return the table of sessions, a column per session: rows, rate, every fault counted."""
    columns = [
        {
            "Kind": s.kind,
            "Status": "rejected" if s.rejected else "used",
            **quality_figures(s.quality),
        }
        for s in device.sessions
    ]
    # what no session has is not worth a row
    rows = [(name, *(column[name] for column in columns)) for name in columns[0]]
    return Table(
        "Sessions and the quality of their logs",
        ("Figure, unit", *(session.name for session in device.sessions)),
        [row for row in rows if not NOTHING.issuperset(row[1:])],
    )


def quality_figures(q):
    """Return the figures of quality.json as text by their name and unit."""
    jitter, clock, limits = q["jitter"]["std_s"], q["clock"] or {}, q["temperature_range"]
    mended = text_of({name: clock.get(key) for name, key in MENDED.items()})
    # without a full scale nobody can tell
    clipped = {k: v for k, v in q["clipped"].items() if v is not None}
    return {
        "Rows used": text_of(q["rows"]),
        "Duration": duration(q["duration_s"]),
        "Rate, Hz": number(q["rate_hz"], 5),
        "Jitter, 1 σ, ms": number(None if jitter is None else round(jitter * 1e3, 6)),
        "Stamps mended": "rebuilt from the row number" if clock.get("rebuilt") else mended,
        "Clock from the declared rate, ppm": number(clock.get("drift_ppm")),
        "Clock from GNSS time, ppm": number((clock.get("pps") or {}).get("drift_ppm")),
        "Gaps": text_of(q["gaps"]["count"]),
        "Gaps in all, s": number(q["gaps"]["total_s"]),
        **{f"{words}, rows": text_of(q[key]) for key, words in DROPPED.items()},
        "Clipped, values": text_of(clipped) if clipped else "not known, no full_scale",
        "Constant channels": text_of(q["constant"]),
        **_faults(q["faults"]),
        "Temperature, °C": " to ".join(map(number, limits)) if limits else "not logged",
        "Start": text_of(q["start"]),
        "Units as logged": text_of(q["units"]),
    }


def _faults(found):
    """Return the faults of the values themselves, which stay in the samples; none without rows."""

    def rows(key):
        return text_of({k: v["rows"] for k, v in found.get(key, {}).items()})

    def size(key, within):
        return number((found.get(key) or {}).get(within))

    held = {sensor: n for sensor, n in (found.get("rows_a_value") or {}).items() if n > 1}
    rests = found.get("rests") or {}
    figures = {
        "Zero on all axes, rows": text_of(found.get("zero_rows")),
        "Stuck at one value, rows": rows("stuck"),
        "Without noise at rest": text_of(found.get("silent_at_rest")),
        "Spikes of one sample, left": text_of(found.get("spikes")),
        "Clipped at a repeated extreme, rows": rows("clipped_at"),
        "Rows that a value is held": text_of(held) if held else "1",
        "Axes that are copies": text_of([f"{b} of {a}" for a, b in found.get("copies", ())]),
        "Specific force at rest, m/s²": number((rests.get("force") or [None] * 2)[1], 4),
        "Turns by angular rate and by gravity alike, 1 at best": size("axes", "agreement"),
        "Turns by angular rate per turns of gravity, rest to rest": number(
            (rests.get("turn_ratio") or {}).get("value")
        ),
    }
    return figures if found else dict.fromkeys(figures, NO_NUMBER)
