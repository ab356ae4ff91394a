"""Whether temperature and time can be told apart, and how to heat and cool where they cannot."""

import numpy as np

from imuloop.core.samples import TEMPERATURE, TIME
from imuloop.report.numbers import joined, number
from imuloop.report.results import SENSORS
from imuloop.report.verdict import PARTS, block_of

# span of a temperature that says anything, K, and the correlation with time from which on it and
# time are the same to a fit
SPAN_K, MONOTONE = 2.0, 0.9
# σ so many times larger is as good as none
HOPELESS = 20.0
# effects that follow time
_WITH_TIME = {"bias_drift", "warm_up", "ramp"}


def heat_and_cool(device):
    """Yield that temperature and time cannot be told apart, and how to heat and cool."""
    worst = None
    for session in device.used:
        if TEMPERATURE not in session.samples:
            continue
        warmth = session.samples[TEMPERATURE]
        known = np.flatnonzero(np.isfinite(warmth))
        few = known[:: max(1, len(known) // 2000)]
        t, warmth = session.samples.at(TIME, few), warmth[few]
        if len(t) < 3 or np.ptp(warmth) < SPAN_K:
            continue
        r = float(np.corrcoef(t, warmth)[0, 1])
        if abs(r) < MONOTONE:
            # one record in which each temperature came twice is enough
            return
        if worst is None or np.ptp(warmth) > np.ptp(worst[2]):
            worst = (r, session.name, warmth)
    if worst is None:
        return
    r, name, warmth = worst
    low, high = np.quantile(warmth, [0.005, 0.995])
    factor = 1 / np.sqrt(max(1 - r**2, 1e-6))
    pairs = sorted(
        {
            " and ".join(sorted((p["effect"], p["with"])))
            for sensor in SENSORS
            for part in PARTS
            for p in block_of(device.diagnosis, sensor, part).get("confounded") or []
            if "temperature" in p["effect"] + p["with"] and {p["effect"], p["with"]} & _WITH_TIME
        }
    )
    also = f" These data cannot tell apart {joined(pairs)}." if pairs else ""
    course, span = "rose" if r > 0 else "fell", f"{number(low, 3)} to {number(high, 3)}\u202f°C"
    times = f"more than {HOPELESS:g}" if factor > HOPELESS else number(factor, 2)
    yield (
        1 - 1 / factor,
        f"Heat and cool: in session {name} the temperature only {course} ({span}, correlation with "
        f"time {number(r, 2)}), so that a temperature coefficient beside a drift has "
        f"{times} times the σ that it could have.{also} Go from {span} and back, "
        "twice, within one record.",
    )
