"""How logs call columns and units: the table `names.yaml`, and what a name says by it."""

import re
import unicodedata
from fnmatch import translate
from functools import lru_cache
from itertools import islice, product
from pathlib import Path

import yaml

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ACCELERATION as FORCES
from imuloop.core.samples import ANGULAR_RATE as RATES
from imuloop.core.units import ACCELERATION, ANGULAR_RATE, INCREMENTS, TIME
from imuloop.core.units import TEMPERATURE as DEGREES

AXES = ("x", "y", "z")
# names there of the axes of each sensor
SENSORS = {"acceleration": FORCES, "angular_rate": RATES}
# units that are read, the first where neither the config nor the log says; count needs nominal
UNITS = {
    "time": (*TIME,),
    "acceleration": (*ACCELERATION, "count", *INCREMENTS["acceleration"]),
    "angular_rate": (*ANGULAR_RATE, "count", *INCREMENTS["angular_rate"]),
    "temperature": (*DEGREES,),
    "interval": (*TIME,),
}
TABLE = yaml.safe_load(Path(__file__).with_name("names.yaml").read_text(encoding="utf-8"))
_NAMES = TABLE["columns"]
_PLACE, _DERIVED = (frozenset(TABLE[key]) for key in ("place", "derived"))
_SHOWS = {q: re.compile("|".join(map(translate, _NAMES[q]["words"]))) for q in SENSORS}
# names of one word, to which an axis may be joined: gx, xacc
_JOINED = {n for q in SENSORS for kind, of in _NAMES[q].items() for n in of if kind != "words"}
# between words that have no sign between them
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[XYZ])(?=[A-Z][a-z]|dps)")
# an axis in brackets, at the end but for the unit: acc[0], Accelerometer (z) [g]
_INDEX = re.compile(r"[\[({]([012xyz])[\])}](?=\s*([\[({]|\Z))", re.IGNORECASE)
_BRACKETS = re.compile(r"[\[({]((?:[^\[\](){}]|\([^()]*\))*)[\])}]")
# how a name may show a quantity, the best first: the keys of the table, and after a prefix
_KINDS = ("names", "second", "increments", "words", "prefixed", "last")
_USUAL = [(_KINDS.index(kind), False) for kind in ("names", "second")]
_WORDS, _PREFIXED = _KINDS.index("words"), _KINDS.index("prefixed")
_NONE = (len(_KINDS), False), 0, "", ""
# a column of whole seconds, one of its part, and how many ns that counts
_WHOLE = re.compile(r"(.*?)secs?|()seconds", re.IGNORECASE)
_PART = re.compile(r"(.*?)(n|nano|u)secs?|()(nano|micro|milli)seconds", re.IGNORECASE)
_PART_NS = {"n": 1, "nano": 1, "u": 1000, "micro": 1000, "milli": 10**6}


def _plain(text):
    text = unicodedata.normalize("NFKC", str(text)).lower().replace("°", "deg").replace("μ", "u")
    return re.sub(r"[\W_]", "", text)


_SPELT = {
    quantity: {_plain(text): unit for unit, others in units.items() for text in (unit, *others)}
    for quantity, units in TABLE["units"].items()
}
_SPELT["interval"] = _SPELT["time"]


def stated_unit(quantity, text, increments=False):
    """Return the contract's name of a unit as a file spells it, m/s^2 of "m s^-2", or None.

    Who writes `deg` beside a rate means deg/s: an angle counts as an increment only where
    `increments`.
    """
    unit = _SPELT[quantity].get(_plain(text))
    summed = unit in INCREMENTS.get(quantity, ())
    if summed and not increments:
        return f"{unit}/s" if f"{unit}/s" in UNITS[quantity] else None
    return unit if increments == summed else None


def is_iso(unit):
    """Tell whether a time unit is declared as ISO 8601, however it is spelt."""
    return _plain(unit) in ("iso", "iso8601")


def unknown_unit(quantity, text):
    """Return the error of a log that states a unit that is not known."""
    return ImuloopError(
        f"units.{quantity}: the log says '{text[:80]}', which is no unit that is read; declare "
        f"the right one of {', '.join(UNITS[quantity])}"
    )


@lru_cache(1 << 15)
def _parts(name):
    """Return the words of a name before and after its axis, the axis or None, and its unit.

    The unit is the text of the last brackets. An axis may be a word or joined to the one of a name.
    """
    # what is longer is no name
    text = unicodedata.normalize("NFKC", name[-99:])
    text = _INDEX.sub(lambda at: f" {'xyzxyz'['012xyz'.index(at[1].lower())]} ", text)
    brackets = re.search(_BRACKETS.pattern + r"\s*\Z", text)
    words = re.findall(r"[^\W_]+", _CAMEL.sub("_", _BRACKETS.sub(" ", text)).lower())
    found = []
    for i, word in enumerate(words):
        for axis, rest in ((word[-1], word[:-1]), (word[0], word[1:])):
            if axis in AXES and (not rest or rest in _JOINED):
                # one by itself goes first, of several the last
                found.append((not rest, i, axis, [rest] * bool(rest)))
    _, i, axis, rest = max(found, default=(0, len(words), None, []))
    return (*words[:i], *rest), axis, (*words[i + 1 :],), brackets[1].strip() if brackets else ""


def words_of(name):
    """Return the lower-case words of a column's name, without its axis, unit in brackets, place."""
    before, _, after, _ = _parts(name)
    return [word for word in (*before, *after) if word not in _PLACE]


def named_sensor(text):
    """Return the sensor that a word or a file's name stands for, or None."""
    words = words_of(str(text))
    found = {q for q, shows in _SHOWS.items() if any(map(shows.match, words))}
    return found.pop() if len(found) == 1 and not _DERIVED & {*words} else None


def _ending(quantity, words, alone=True):
    """Return how many words are left before the unit that ends them; a letter is none `alone`."""
    for k in range(len(words)):
        text = "".join(words[k:])
        if text in _SPELT[quantity] and (alone or k or len(text) > 1):
            return k
    return len(words)


def unit_of(quantity, where, names, increments=False):
    """Return the unit that the names of columns state: 'ax [g]', 'time_us', 'gx deg/s'.

    One that is not known is given as it is written, and several where they differ.
    """
    where = where if isinstance(where, tuple) else (where,)
    units = dict.fromkeys(_unit_in(quantity, names[i], increments) for i in where)
    return " and ".join(unit for unit in units if unit) or None


def _unit_in(quantity, name, increments=False):
    before, axis, after, text = _parts(name)
    if text and not text.isdigit():
        return stated_unit(quantity, text, increments) or text
    words = after or before
    text = "".join(words[_ending(quantity, words, after or not axis) :])
    unit = stated_unit(quantity, text, increments) if text else None
    # raw is a place before the axis
    return None if unit == "count" and axis and not after else unit


def increment_name(quantity, name):
    """Return the name in the table by which a column is a sensor's increment, or None."""
    (kind, _), _, known, _ = _match(quantity, name)
    return known if kind == _KINDS.index("increments") else None


def two_parts(names):
    """Return the columns of whole seconds and their part, and how many ns the part counts.

    None where no two are called alike: sec and nsec, seconds and milliseconds.
    """
    whole = {found[1] or "": at for at, n in enumerate(names) if (found := _WHOLE.fullmatch(n))}
    for at, name in enumerate(names):
        found = _PART.fullmatch(name)
        if found and (found[1] or "") in whole:
            return whole[found[1] or ""], at, _PART_NS[(found[2] or found[4]).lower()]
    return None


def guess(names, alone=None, usual=True):
    """Return quantity -> [(position or three positions, name without axis)], best first.

    Of the sensors all that are returned have names as good. With `usual` these are the usual ones;
    without, they may also be of increments, state their unit before the axis, show the sensor by a
    word, follow a prefix of both sensors, or, if only the sensor `alone` is looked for, be any
    three.
    """
    triples, found = _triples(names), {}
    clock = any({*TABLE["clock"]} & {*words_of(name)} for name in names)
    for quantity in _NAMES:
        groups = triples if quantity in SENSORS else [[(at,)] for at in range(len(names))]
        found[quantity] = [(*_match(quantity, names[at[0][0]]), at) for at in groups]
    shared = set.intersection(*({m[3] for m in found[q]} for q in ([alone] if alone else SENSORS)))
    shared = set() if usual else shared - {""}
    for quantity, matches in found.items():
        sensor, fine = quantity in SENSORS, [m for m in matches if m[0] < _NONE[0]]
        if usual and sensor:
            fine = [m for m in fine if m[0] in _USUAL]
        fine = [m for m in fine if m[0][0] != _PREFIXED or m[3] in shared]
        if not sensor:
            # of several devices it is not known whose it is, and seconds may be of a clock
            fine = sorted(m for m in fine if m[0][0] != _PREFIXED or len(shared) == 1)
            fine = [m for m in fine if not (clock and m[2] in _SPELT["time"])]
            found[quantity] = [(at, known) for _, _, known, _, [[at]] in fine]
            continue
        if not fine and alone == quantity and len(triples) == 1 and not usual:
            fine = [(*_NONE, triples[0])]
        best = min((m[0] for m in fine), default=None)
        found[quantity] = [(at, m[2]) for m in fine if m[0] == best for at in m[4]]
    return found


def _triples(names):
    """Return the positions of x, y and z of names that are alike but for the axis.

    Where names repeat there are several; two are enough.
    """
    found = {}
    for at, name in enumerate(names):
        before, axis, after, unit = _parts(name)
        if axis:
            found.setdefault((before, after, unit), {a: [] for a in AXES})[axis].append(at)
    three = [[*islice(product(*axes.values()), 2)] for axes in found.values()]
    return [each for each in three if each]


def _match(quantity, name):
    """Return how a name is one of a quantity's, `_NONE` of one that is not.

    That is the kind of name, whether a unit ends it, its place and name in the table, and a prefix.
    """
    before, _, after, unit = _parts(name)
    known, words, unit = _NAMES[quantity], (*before, *after), _plain(unit)
    # Time (UTC) may be one, T (°) is none
    strange = quantity not in SENSORS and bool(unit) and unit not in _SPELT[quantity]
    end = _ending(quantity, before or after, quantity not in SENSORS)
    options = [
        " ".join(word for word in part if word not in _PLACE)
        for part in (before or after, (before or after)[:end])
    ]
    if strange and any(unit in units for units in _SPELT.values()):
        return _NONE
    for (rank, kind), (stripped, option) in product(enumerate(_KINDS), enumerate(options)):
        if option in known.get(kind, ()) and not (before and _DERIVED & {*after}):
            return (rank + strange, bool(stripped)), known[kind].index(option), option, ""
    if _DERIVED & {*words}:
        return _NONE
    for i, word in enumerate(words):
        if quantity in SENSORS and _SHOWS[quantity].match(word):
            prefix = " ".join(each for each in words[:i] if each not in _PLACE)
            return (_WORDS, False), 0, word, prefix
    for option in options:
        for blank in re.finditer(" ", option):
            if (rest := option[blank.end() :]) in known["names"]:
                place = known["names"].index(rest)
                return (_PREFIXED, False), place, rest, option[: blank.start()]
    return _NONE
