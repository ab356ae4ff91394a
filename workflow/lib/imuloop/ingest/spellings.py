"""Usual names of columns and units in logs, by the table `names.yaml`."""

import re
import unicodedata
from fnmatch import translate
from functools import cache
from itertools import islice, product
from pathlib import Path
from typing import NamedTuple

import yaml

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ACCELERATION as FORCES
from imuloop.core.samples import ANGULAR_RATE as RATES
from imuloop.core.units import FACTORS, INCREMENTS, TIME
from imuloop.core.units import TEMPERATURE as DEGREES

AXES = ("x", "y", "z")
# names of the axes of each sensor in samples
SENSORS = {"acceleration": FORCES, "angular_rate": RATES}
# units that are read; the first counts if neither config nor log states one; count needs nominal
UNITS = {
    "time": (*TIME,),
    **{quantity: (*FACTORS[quantity], "count", *INCREMENTS[quantity]) for quantity in FACTORS},
    "temperature": (*DEGREES,),
    "interval": (*TIME,),
}
TABLE = yaml.safe_load(Path(__file__).with_name("names.yaml").read_text(encoding="utf-8"))
_PLACE, _DERIVED, _CLOCK = (frozenset(TABLE[key]) for key in ("place", "derived", "clock"))
# ways in which a name shows a quantity, the best first: as a key of the table says, or,
# `_PREFIXED`, by a usual name after other words
_USUAL, _INCREMENTS, _WORDS, _PREFIXED, _LAST = range(5)
_KINDS = {"names": _USUAL, "increments": _INCREMENTS, "last": _LAST}
# name -> its kind, and its place among the names of that kind
_NAMES = {
    quantity: {n: (k, i) for kind, k in _KINDS.items() for i, n in enumerate(names.get(kind, ()))}
    for quantity, names in TABLE["columns"].items()
}
_SHOWS = {q: re.compile("|".join(map(translate, TABLE["columns"][q]["words"]))) for q in SENSORS}
# places between two words without a sign between them
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[XYZ])(?=[A-Z][a-z]|dps)")
# an axis in brackets, at the end but for the unit: acc[0], Accelerometer (z) [g]
_INDEX = re.compile(r"[\[({]([012xyz])[\])}](?=\s*([\[({]|\Z))", re.IGNORECASE)
_BRACKETS = re.compile(r"[\[({]((?:[^\[\](){}]|\([^()]*\))*)[\])}]")
# name of a column of whole seconds, and name of a column of parts of a second
_WHOLE = re.compile(r"(.*?)(?:secs?|seconds)", re.IGNORECASE)
_PART = re.compile(r"(.*?)((?:n|u|nano|micro|milli)(?:secs?|seconds))", re.IGNORECASE)


def _plain(text):
    """Return the letters and digits of `text` in lower case, with deg for ° and u for μ.

    Texts that spell a name or a unit in different ways become equal.
    """
    text = unicodedata.normalize("NFKC", str(text)).lower().replace("°", "deg").replace("μ", "u")
    return re.sub(r"[\W_]", "", text)


_SPELT = {
    quantity: {_plain(text): unit for unit, others in units.items() for text in (unit, *others)}
    for quantity, units in TABLE["units"].items()
}
_SPELT["interval"] = _SPELT["time"]


class _Match(NamedTuple):
    """How the name of a column shows a quantity; of several matches the smallest is the best.

    `kind` is the way in which the name shows the quantity, one of the numbers from `_USUAL`, the
    best, to `_LAST`. Matches are compared as tuples. `ending` tells whether the words of a unit at
    the end were left out. `skipped` is the number of words before the known `name`; these words are
    the `prefix`. `place` is the index of the known name in the table.
    """

    kind: int
    ending: bool
    skipped: int
    place: int
    name: str
    prefix: str = ""


def stated_unit(quantity, text, increments=False):
    """Return the unit that `text` spells for a quantity, as the config names it; None if unknown.

    "m s^-2" is m/s^2. `quantity` is the name of the quantity. A unit of an increment, such as deg,
    counts only if `increments` is true. Otherwise a log that has deg as the unit of a rate means
    deg/s.
    """
    unit = _SPELT[quantity].get(_plain(text))
    summed = unit in INCREMENTS.get(quantity, ())
    if summed and not increments:
        return f"{unit}/s" if f"{unit}/s" in UNITS[quantity] else None
    return unit if increments == summed else None


def is_iso(unit):
    """Return whether `unit`, a unit of time in any spelling, is ISO 8601, that is, dates."""
    return _plain(unit) in ("iso", "iso8601")


def unknown_unit(quantity, text):
    """Return the ImuloopError of a log that states an unknown unit of a quantity.

    `quantity` is the name of the quantity, and `text` the unit as the log states it.
    """
    return ImuloopError(
        f"units.{quantity}: the log says '{text}', which is not a known unit; declare "
        f"the right one of {', '.join(UNITS[quantity])}"
    )


@cache
def _parts(name):
    """Return the words of a column's name before its axis, its axis, the words after, and its unit.

    `name` is the name. The words are tuples. The axis is None in a name without one; it is a word
    by itself, or it is joined to a known name, as in gx. The unit is the text in the last brackets,
    or empty.
    """
    # longer texts are not names
    text = unicodedata.normalize("NFKC", name[-99:])
    text = _INDEX.sub(lambda at: f" {'xyzxyz'['012xyz'.index(at[1].lower())]} ", text)
    brackets = re.search(_BRACKETS.pattern + r"\s*\Z", text)
    words = re.findall(r"[^\W_]+", _CAMEL.sub("_", _BRACKETS.sub(" ", text)).lower())
    axes = []
    for i, word in enumerate(words):
        for axis, rest in ((word[-1], word[:-1]), (word[0], word[1:])):
            if axis in AXES and (not rest or any(rest in _NAMES[q] for q in SENSORS)):
                # an axis that is a word by itself comes first, among several the last one
                axes.append((not rest, i, axis, [rest] * bool(rest)))
    _, i, axis, rest = max(axes, default=(0, len(words), None, []))
    return (*words[:i], *rest), axis, (*words[i + 1 :],), brackets[1].strip() if brackets else ""


def words_of(name):
    """Return the words of a column's `name` in lower case, a list.

    The axis, a unit in brackets, and words for a place on a body are left out.
    """
    before, _, after, _ = _parts(name)
    return [word for word in (*before, *after) if word not in _PLACE]


def named_sensor(text):
    """Return the quantity of the sensor that a text, such as a file's name, names, or None.

    The result is also None if `text` names both sensors, or a quantity that is derived from them.
    """
    words = words_of(str(text))
    sensors = {q for q, shows in _SHOWS.items() if any(map(shows.match, words))}
    return sensors.pop() if len(sensors) == 1 and _DERIVED.isdisjoint(words) else None


def _ending(quantity, words, alone=True):
    """Return the index in a list of words at which a unit at their end starts.

    `words` are the words of a column's name, and the unit is one of `quantity`. If they do not end
    in such a unit, the result is the number of words. A single letter by itself is a unit only if
    `alone`.
    """
    for k in range(len(words)):
        text = "".join(words[k:])
        if text in _SPELT[quantity] and (alone or k or len(text) > 1):
            return k
    return len(words)


def unit_of(quantity, places, names, increments=False):
    """Return the unit that the names of columns state, such as 'ax [g]', 'time_us', 'gx deg/s'.

    `quantity` is the quantity in these columns, and `places` are their positions in `names`, the
    names of all columns. `increments` tells whether the columns hold increments. An unknown unit is
    returned as it is written, and different units as one text. The result is None if no name states
    a unit.
    """
    units = {}
    for at in places:
        before, axis, after, text = _parts(names[at])
        if text and not text.isdigit():
            units[stated_unit(quantity, text, increments) or text] = at
            continue
        words = after or before
        text = "".join(words[_ending(quantity, words, after or not axis) :])
        unit = stated_unit(quantity, text, increments) if text else None
        # the word raw before the axis is not a unit
        if unit and (unit != "count" or after or not axis):
            units[unit] = at
    return " and ".join(units) or None


def names_device(name):
    """Return whether a column called `name` tells the device of each row, as ``sensor_id`` does."""
    return _plain(name) in TABLE["device"]


def increment_name(quantity, name):
    """Return the known name of increments that the name of a column shows, or None.

    An increment is the integral of a sensor's output. `quantity` is the quantity of the sensor, and
    `name` the name of the column.
    """
    match = _match(quantity, name)
    return match.name if match and match.kind == _INCREMENTS else None


def two_parts(names):
    """Return the positions of the columns of whole seconds and of parts of a second, and a unit.

    The positions are a tuple, and the unit is the unit of the parts, ns. `names` are the names of
    all columns. Names of such columns are sec and nsec, or seconds and milliseconds. The result is
    (None, 1) if no two columns have such names.
    """
    whole = {match[1]: at for at, name in enumerate(names) if (match := _WHOLE.fullmatch(name))}
    for at, name in enumerate(names):
        match = _PART.fullmatch(name)
        if match and match[1] in whole:
            return (whole[match[1]], at), round(TIME[stated_unit("time", match[2])] * 1e9)
    return None, 1


def guess(names, alone=None, usual=True):
    """Return the columns that may hold each quantity, by their names, {quantity: list}.

    `names` are the names of all columns. An entry of a list is a tuple of positions, three for a
    sensor and one for others. The best entry comes first; all entries of a sensor are equally good.
    If `usual`, only usual names count. Otherwise a name may also be one of an increment, show the
    sensor by a word, or follow a prefix that both sensors have. If only one sensor is logged,
    `alone` is its quantity; then any three columns x, y, z count.
    """
    triples, matches, places = _triples(names), {}, {}
    for quantity in _NAMES:
        groups = triples if quantity in SENSORS else [[(at,)] for at in range(len(names))]
        pairs = [(_match(quantity, names[group[0][0]]), group) for group in groups]
        matches[quantity] = [(match, group) for match, group in pairs if match]
    prefixes = [{m.prefix for m, _ in matches[q]} for q in ([alone] if alone else SENSORS)]
    shared = set() if usual else set.intersection(*prefixes) - {""}
    clock = any(not _CLOCK.isdisjoint(words_of(name)) for name in names)
    for quantity, pairs in matches.items():
        fine = [pair for pair in pairs if pair[0].kind != _PREFIXED or pair[0].prefix in shared]
        if quantity not in SENSORS:
            # several prefixes may stand for several devices: it is not clear which one counts
            fine = sorted(m for m in fine if m[0].kind != _PREFIXED or len(shared) == 1)
            # a column of seconds may be a part of a clock, as in hours, minutes, seconds
            fine = [m for m in fine if not (clock and m[0].name in _SPELT["time"])]
        elif usual:
            fine = [m for m in fine if m[0].kind in (_USUAL, _LAST) and not m[0].ending]
        best = min((match[:2] for match, _ in fine), default=None)
        if quantity in SENSORS:
            fine = [(match, group) for match, group in fine if match[:2] == best]
        places[quantity] = [at for _, group in fine for at in group]
        if not fine and alone == quantity and len(triples) == 1 and not usual:
            places[quantity] = triples[0]
    return places


def _triples(names):
    """Return the positions of columns x, y and z whose names differ only in the axis.

    `names` are the names of all columns. The result is a list with an entry for each set of such
    names: a list of tuples of three positions. An entry has one tuple. If a name repeats, it has
    two; more are left out, because two suffice to show that the columns are ambiguous.
    """
    alike = {}
    for at, name in enumerate(names):
        before, axis, after, unit = _parts(name)
        if axis:
            alike.setdefault((before, after, unit), {a: [] for a in AXES})[axis].append(at)
    triples = [[*islice(product(*axes.values()), 2)] for axes in alike.values()]
    return [group for group in triples if group]


def _match(quantity, name):
    """Return how well the name of a column shows a quantity, the best `_Match`, or None.

    `quantity` is the name of the quantity, and `name` the name of the column.
    """
    before, _, after, unit = _parts(name)
    words, sensor = before or after, quantity in SENSORS
    # the unit may be unknown, as in Time (UTC), but not of another quantity, as in T (°)
    strange = not sensor and bool(unit) and _plain(unit) not in _SPELT[quantity]
    if strange and any(_plain(unit) in units for units in _SPELT.values()):
        return None
    derived, matches = _DERIVED.intersection((*before, *after)), []
    parts = words, words[: _ending(quantity, words, not sensor)]
    for ending, part in enumerate([word for word in part if word not in _PLACE] for part in parts):
        for k in range(len(part)):
            name, prefix = " ".join(part[k:]), " ".join(part[:k])
            kind, place = _NAMES[quantity].get(name, (None, 0))
            if k == 0 and kind is not None and not (before and _DERIVED.intersection(after)):
                matches.append(_Match(kind + strange, bool(ending), 0, place, name))
            elif kind == _USUAL and not derived:
                matches.append(_Match(_PREFIXED, False, k, place, name, prefix))
    for k, word in enumerate((*before, *after) if sensor and not derived else ()):
        if _SHOWS[quantity].match(word):
            prefix = " ".join(w for w in (*before, *after)[:k] if w not in _PLACE)
            matches.append(_Match(_WORDS, False, k, 0, word, prefix))
    return min(matches, default=None)
