"""What was recorded: sessions, quality, source, and what the segmentation made of them."""

from imuloop.core.segments import KINDS
from imuloop.report.numbers import NO_NUMBER, duration, number
from imuloop.report.table import Table

# rows that ingest drops, by the reason it counts them under
DROPPED = {
    "duplicates": "Repeated stamps",
    "out_of_order": "Out of order",
    "non_finite": "Non-finite",
    "bad_lines": "Unreadable",
    "outside_time_range": "Outside the time range",
}


def text_of(value):
    """Return a figure of quality.json in a few words, whatever its form."""
    if value is None:
        return NO_NUMBER
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return number(value) if isinstance(value, float) else f"{value:,}".replace(",", "\u202f")
    if isinstance(value, dict):
        kept = {k: v for k, v in value.items() if v not in (0, None, [], {})}
        return ", ".join(f"{k} {text_of(v)}" for k, v in kept.items()) or "0"
    if isinstance(value, (list, tuple)):
        return ", ".join(text_of(v) for v in value) or "none"
    return str(value)


def data_table(device):
    """Return the table of sessions: rows, rate, and every fault that was counted."""
    rows = []
    for session in device.sessions:
        q = session.quality
        jitter = q["jitter"]["std_s"]
        rows.append(
            (
                session.name,
                session.kind,
                "rejected" if session.rejected else "used",
                text_of(q["rows"]),
                duration(q["duration_s"]),
                number(q["rate_hz"], 5),
                number(None if jitter is None else jitter * 1e3),
                f"{q['gaps']['count']}",
                number(q["gaps"]["total_s"]),
                *(text_of(q.get(key)) for key in DROPPED),
                text_of(q.get("clipped")),
                text_of(q.get("constant")),
                _span(q.get("temperature_range")),
            )
        )
    treatment = [t for s in device.sessions if (t := s.quality.get("treatment"))]
    return Table(
        "Sessions and the quality of their logs",
        (
            *("Session", "Kind", "Status", "Rows used", "Duration", "Rate, Hz"),
            *("Jitter, 1 σ, ms", "Gaps", "Gaps in all, s"),
            *(f"{words}, rows" for words in DROPPED.values()),
            *("Clipped, values", "Constant channels", "Temperature, °C"),
        ),
        tuple(rows),
        " ".join(["Jitter: scatter of the time between samples.", *treatment[:1]]),
    )


def _span(limits):
    """Return the least and greatest temperature of a session."""
    if not limits or None in limits:
        return "not logged"
    return " to ".join(number(v) for v in limits)


def warnings(device):
    """Return what ingest wants a user to look at: (session, text)."""
    return [(s.name, text) for s in device.sessions for text in s.quality.get("warnings") or []]


def source_table(device):
    """Return the table of log files: where each came from, its units and its hash."""
    rows = [
        (
            session.name,
            file,
            text_of(session.source.get("units")),
            text_of(session.source.get("source")),
            text_of(session.source.get("start")),
            digest,
        )
        for session in device.sessions
        for file, digest in (session.source.get("sha256") or {}).items()
    ]
    columns = ("Session", "File", "Units as logged", "Source", "Start", "SHA-256")
    return Table("Log files", columns, tuple(rows))


def segment_table(device):
    """Return the table of stretches: how long each session was at rest, moving, disturbed."""
    rows = []
    for session in device.used:
        s = session.segments
        length = (s["end_s"] - s["start_s"]).groupby(s["kind"]).sum()
        rests = s["pose"] >= 0
        rows.append(
            (
                session.name,
                str(s.loc[rests, "pose"].nunique()),
                str(int(rests.sum())),
                *(duration(length.get(kind, 0.0)) for kind in KINDS),
                text_of(session.segmentation.get("short_rests")),
                text_of(session.segmentation.get("multiples")),
            )
        )
    return Table(
        "Stretches found in each session",
        (
            *("Session", "Poses", "Rests", "Static", "Motion", "Disturbed", "Gap"),
            *("Short rests dropped", "Detector, multiples of the rest's variance"),
        ),
        tuple(rows),
        "A pose is one attitude held; several rests in the same attitude count as one pose. "
        "Detector: a stretch is static where its variance stays below this multiple "
        "(accelerometer, gyroscope) of the variance at rest.",
    )
