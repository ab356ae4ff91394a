"""How long a device has to rest for its noise to show, in sentences with hours."""

import numpy as np

from imuloop.core.samples import CHANNELS
from imuloop.core.units import HOUR
from imuloop.report.numbers import NOISE_UNITS, duration, joined, missing, number, with_unit
from imuloop.report.recording_gain import MATTERS, plans
from imuloop.report.recording_words import sigma_words
from imuloop.report.results import SENSORS

# white noise, flicker and walk of a usual MEMS sensor are equal in the Allan curve here, s
FLICKER_S, WALK_S = 100.0, 1000.0
# the longest record worth asking for, s, and the share of its upper limit by which one has to fall
LONGEST_RECORD, WORTH = 24 * HOUR, 0.5


def initial_rest(device):
    """Yield how long the first rest has to be until flicker limits the gyroscope's mean rate."""
    parameters, _ = plans(device, "gyroscope")
    if not any(((parameters.get(f"b{i}") or {}).get("weight") or 0.0) > MATTERS for i in range(3)):
        return
    axes = device.noise.get("axes") or {}
    for session in device.used:
        segments, first = session.segments, session.segments["pose"] == 0
        if session.kind != "multi_position" or not first.any():
            continue
        now = float((segments["end_s"] - segments["start_s"])[first].sum())
        needs = []
        for channel in SENSORS["gyroscope"]:
            white, flat = ((axes.get(channel) or {}).get(k, {}).get("value") for k in "NB")
            if not missing(white) and not missing(flat) and flat:
                flat *= np.sqrt(2 * np.log(2) / np.pi)
                needs.append(((white / flat) ** 2, white, flat, channel))
        needed, white, flat, channel = max(needs, default=(0.0, 0.0, 0.0, ""))
        if now < needed <= HOUR:
            before, after = (np.hypot(white / np.sqrt(t), flat) for t in (now, needed))
            yield (
                1 - after / before,
                f"Begin session {session.name} with {duration(needed, 2)} at rest (now "
                f"{duration(now, 2)}): the error of the mean of {channel} falls from "
                f"{sigma_words('rad/s', before, after)}; from there on flicker noise limits it.",
            )


def static_record(device):
    """Yield the length of a record at rest that would show flicker and walk."""
    longest = max(
        (s.quality.get("duration_s") or 0.0 for s in device.used if s.kind == "static"), default=0.0
    )
    rates = [s.quality.get("rate_hz") for s in device.used if not missing(s.quality.get("rate_hz"))]
    axes = device.noise.get("axes") or {}
    if not rates:
        return
    wanted, limited = [], []
    for channel in CHANNELS:
        axis = axes.get(channel) or {}
        white = (axis.get("N") or {}).get("value")
        if missing(white):
            continue
        usual = {
            "B": white * np.sqrt(np.pi / (2 * np.log(2) * FLICKER_S)),
            "K": white * np.sqrt(3) / WALK_S,
        }
        for name, size in usual.items():
            upper = (axis.get(name) or {}).get("upper95")
            if (axis.get(name) or {}).get("identifiable") or not upper:
                continue
            limited.append(f"{name} of {channel}")
            target = min(upper, size)
            # a limit may be zero
            if target >= (1 - WORTH) * upper:
                continue
            # loads for a second, and few devices need it
            from imuloop.noise.needed import needed_seconds

            seconds = needed_seconds(name, target, *_processes(axis), 1 / min(rates), 0.05)
            if seconds and longest < seconds <= LONGEST_RECORD:
                wanted.append((seconds, name, channel, upper, target))
    if not wanted:
        if limited and not longest:
            yield (
                0.0,
                f"Record 2\u202fh at rest: there is no static record, and {joined(limited)} are "
                "known as upper limits only.",
            )
        return
    seconds = max(w[0] for w in wanted)
    _, name, channel, upper, target = max(wanted, key=lambda w: w[3] / w[4])
    sensor = next(s for s, channels in SENSORS.items() if channel in channels)
    shown = {n: [c for _, m, c, *_ in wanted if m == n] for n in "BK"}
    axes = {
        n: "all six axes" if len(channels) == len(CHANNELS) else joined(channels)
        for n, channels in shown.items()
        if channels
    }
    shows = [f"{n} of {words}" for n, words in axes.items()]
    if shown["B"] == shown["K"]:
        shows = [f"B and K of {axes['B']}"]
    unit = NOISE_UNITS[sensor][name][1]
    limits = " to ".join(f"{number(v * unit.factor, 2)}" for v in (upper, target))
    now = f"{duration(longest, 2)} now" if longest else "there is no static record now"
    yield (
        1 - target / upper,
        f"Record {duration(max(seconds, HOUR), 2)} at rest ({now}). Nine times in ten it would "
        f"show {joined(shows)} at the size usual beside this white noise: {name} of {channel}, now "
        f"only limited, would fall from {with_unit(limits, unit.unit)}.",
    )


def _processes(axis):
    """Return squares of Q, N, B, K of an axis of noise.json, and its Gauss-Markov processes."""
    squares = [((axis.get(k) or {}).get("value") or 0.0) ** 2 for k in "QNBK"]
    return squares, [
        (p["q"]["value"] ** 2 * p["tc"]["value"] / 2, p["tc"]["value"])
        for p in axis.get("gauss_markov") or []
    ]
