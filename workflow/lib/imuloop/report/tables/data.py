"""What was recorded: sessions, quality, source, and what the segmentation made of them."""

from itertools import cycle

from imuloop.core.segments import KINDS
from imuloop.report.numbers import NO_NUMBER, duration, number, text_of
from imuloop.report.tables.table import Sized, Table

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
    treatment = [t for s in device.sessions if (t := s.quality["treatment"])]
    return Table(
        "Sessions and the quality of their logs",
        ("Figure, unit", *(session.name for session in device.sessions)),
        [(name, *(column[name] for column in columns)) for name in columns[0]],
        " ".join(["Jitter: scatter of the time between samples.", *treatment[:1]]),
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
        "Format": text_of(q["log_format"]),
        "Units as logged": text_of(q["units"]),
    }


def _faults(found):
    """Return the faults of the values themselves, which stay in the samples; none without rows."""

    def rows(key):
        return text_of({k: v["rows"] for k, v in found.get(key, {}).items()})

    def size(key, within):
        return number((found.get(key) or {}).get(within))

    held = {sensor: n for sensor, n in (found.get("rows_a_value") or {}).items() if n > 1}
    shares = (found.get("noise_near_nyquist") or {}).values()
    rests = found.get("rests") or {}
    figures = {
        "Zero on all axes, rows": text_of(found.get("zero_rows")),
        "Stuck at one value, rows": rows("stuck"),
        "Without noise at rest": text_of(found.get("silent_at_rest")),
        "Spikes of one sample, left": text_of(found.get("spikes")),
        "Clipped at a repeated extreme, rows": rows("clipped_at"),
        "Rows that a value is held": text_of(held) if held else "1",
        "Axes that are copies": text_of([f"{b} of {a}" for a, b in found.get("copies", ())]),
        "Noise near Nyquist, least share of that below": number(
            min((share for share in shares if share is not None), default=None)
        ),
        "Mean angular rate at rest, power as a share of its noise's": size(
            "mean_at_rest", "noise_share"
        ),
        "Specific force at rest, m/s²": number((rests.get("force") or [None] * 2)[1], 4),
        "Turns by angular rate and by gravity alike, 1 at best": size("axes", "agreement"),
        "Turns by angular rate per turns of gravity, rest to rest": number(
            (rests.get("turn_ratio") or {}).get("value")
        ),
    }
    return figures if found else dict.fromkeys(figures, NO_NUMBER)


def source_table(device):
    """Return the table of log files: where each came from and its hash."""
    rows = [
        # an address, a path, or a member of a package's wheel
        (session.name, file, ", ".join(str(v) for k, v in source.items() if k != "sha256"), digest)
        for session in device.sessions
        for source, (file, digest) in zip(
            # a folder is one source of several files
            cycle(session.source["source"].values()),
            session.source["sha256"].items(),
            strict=False,
        )
    ]
    columns = ("Session", "File", "Source", "SHA-256")
    return Table("Log files", columns, rows, sortable=True)


def segment_table(device):
    """Return the table of stretches: how long each session was at rest, moving, disturbed."""

    def counted(count):
        return lambda session: Sized(text_of(value := count(session)), value)

    lengths = {
        kind.capitalize(): lambda s, kind=kind: Sized(duration(s.seconds(kind)), s.seconds(kind))
        for kind in KINDS
    }
    return Table.of(
        "Stretches found in each session",
        device.used,
        {
            "Session": lambda s: s.name,
            "Poses": counted(lambda s: s.poses),
            "Rests": counted(lambda s: int((s.segments["pose"] >= 0).sum())),
            **lengths,
            "Short rests dropped": counted(lambda s: s.segmentation.get("short_rests")),
            "Detector, multiples of the rest's variance": lambda s: text_of(
                s.segmentation.get("multiples")
            ),
        },
        "A pose is one attitude held; several rests in the same attitude count as one pose. "
        "Detector: a stretch is static where its variance stays below this multiple "
        "(accelerometer, gyroscope) of the variance at rest.",
        sortable=True,
    )
