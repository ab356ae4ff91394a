"""The answer on a device in a line: is each sensor good, what was missing, what is left."""

from imuloop.report.numbers import joined, number, with_unit
from imuloop.report.results import SENSORS
from imuloop.report.verdict import PARTS, block_of, reason_of, too_quiet, verdict_of

# verdicts from the best news to none
ORDER = ("consistent", "explained", "partly_explained", "unexplained", "not_testable")


def rank(verdict):
    """Return the place of a verdict from the best news to none."""
    return ORDER.index(verdict) if verdict in ORDER else len(ORDER)


def answers(diagnosis):
    """Return what to say of a device first: each sensor, its worst verdict, words on it.

    Poses come first: they test the calibration. A static record is named where it says more, or
    where there are no poses.

    Parameters
    ----------
    diagnosis : dict
        Content of diagnosis.json.
    """
    said = []
    for sensor in SENSORS:
        poses, still = (block_of(diagnosis, sensor, part) for part in PARTS)
        tested = [v for v in map(verdict_of, (poses, still)) if v != "not_testable"]
        if not tested:
            words = f"not testable: {reason_of(poses)}"
        elif verdict_of(poses) == "not_testable":
            words = f"at rest {_words(still)}; no poses to test it"
        else:
            words = _words(poses)
            if verdict_of(still) not in ("consistent", "not_testable"):
                words += f"; at rest {_words(still)}"
        said.append((sensor, max(tested, key=rank, default="not_testable"), words))
    return said


def _words(block):
    """Return what a tested block says."""
    if too_quiet(block):
        return "far quieter than its own noise allows: corrected or filtered before it was logged"
    effects = joined([e["name"].replace("_", " ") for e in block.get("effects") or []])
    return {
        "consistent": "good to its noise",
        "explained": f"good to its noise with {effects} corrected",
        "partly_explained": f"better with {effects} corrected, but something is still missing",
        "unexplained": "something is missing that no known effect explains",
    }.get(verdict_of(block), verdict_of(block))


def grouped(summaries):
    """Return what is said of the devices, the worst news first, each with those it is said of."""
    groups = {}
    for s in summaries:
        groups.setdefault(tuple(map(tuple, s["answers"])), []).append(s)

    def worst(group):
        said, found = group
        return [-max((rank(verdict) for _, verdict, _ in said), default=0), len(found)]

    return sorted(groups.items(), key=worst)


def best_words(summaries, columns):
    """Return who has the smallest held-out residual of each sensor; empty below two devices.

    Parameters
    ----------
    summaries : list of dict
        Content of summary.json of each device.
    columns : dict
        The comparison's columns by sensor; the first is the held-out residual.
    """
    words = []
    for sensor, (column, *_) in columns.items():
        found = [(f["value"], s["label"]) for s in summaries if (f := s["figures"].get(column.key))]
        if len(found) > 1:
            value, label = min(found)
            size = with_unit(number(value * column.display.factor, 2), column.display.unit)
            words.append(f"{sensor} – {label}, {size}")
    return words
