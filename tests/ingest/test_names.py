"""Which columns of a log hold what, by their names, and which names are asked about."""

import re
from pathlib import Path

import pytest
import yaml

from imuloop.core.errors import ImuloopError
from imuloop.ingest.columns import resolve
from imuloop.ingest.spellings import SENSORS, TABLE, stated_unit

SIX = "ax,ay,az,gx,gy,gz"


def expand(*names):
    """The names of a table, in which *, & and # stand for axes: x y z, X Y Z and 0 1 2."""
    every = ",".join(names).split(",")
    for sign, axes in (("*", "xyz"), ("&", "XYZ"), ("#", "012")):
        every = [n.replace(sign, a) for n in every for a in (axes if sign in n else "-")]
    return every


LOGGERS = yaml.safe_load(Path(__file__).with_name("loggers.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("line", LOGGERS)
def test_the_columns_and_units_of_a_logger_are_known(line):
    header, places, units = (part.strip() for part in line.split("|"))
    columns = resolve(expand(header))
    places = [None if place == "-" else int(place) for place in places.split()]
    assert [columns.raw.get(name) for name in ("stamp", "ax", "gx", "temperature")] == places
    quantities = dict(t="time", a="acceleration", w="angular_rate", T="temperature")
    said = (text.split() for text in units.split(", ") if text)
    assert columns.units == {quantities[letter]: unit for letter, unit in said}


def test_each_line_of_the_table_is_read():
    """Protects those who add a name or a unit there: that is all they have to do."""
    for quantity, kinds in TABLE["columns"].items():
        for kind, name in ((k, n) for k, names in kinds.items() for n in names if k != "words"):
            columns = [f"{name} {axis}" for axis in "xyz"] if quantity in SENSORS else [name]
            others = {q: None for q in SENSORS if q != quantity}
            resolved = resolve(columns, others).names_by_quantity(columns)
            assert resolved == {quantity: columns if quantity in SENSORS else name} or (
                quantity == "interval" and kind == "names"
            )
    for quantity, units in TABLE["units"].items():
        for unit, spelt in units.items():
            for text in (unit, *spelt):
                assert unit in (stated_unit(quantity, text), stated_unit(quantity, text, True))


@pytest.mark.parametrize("six", ["a*,raw_a*", "acc_*_g,acc_*_mps2", "imu.acc.*,raw.acc.*"])
def test_two_accelerometers_must_be_distinguished(six):
    first, last = expand(six)[:3], expand(six)[3:]
    line = re.escape(f"{'/'.join(first)} and {'/'.join(last)} both look like acceleration; name ")
    with pytest.raises(ImuloopError, match=line):
        resolve(expand("t", six, "g*"))
    columns = resolve(expand("t", six, "g*"), {"acceleration": last})
    assert columns.places["acceleration"] == (4, 5, 6)


UNCLEAR = [
    ("t,x,x,z,g*", {"acceleration": ["x", "x", "z"]}, "2 columns are named 'x'"),
    (f"t,{SIX}", {"acceleration": "ax"}, "not a list of three"),
    (f"t,{SIX}", {"time": "ax"}, "column 1, 'ax', is already in columns.time"),
    # what repeats is not chosen by its place
    (f"t,{SIX},ax", {}, "both look like acceleration; .* by number from 0 to 7"),
    (f"t,T,{SIX}", {}, "t and T both look like time"),
    (f"t,{SIX},temp,temp", {}, "both look like temperature"),
]


@pytest.mark.parametrize(("names", "columns", "line"), UNCLEAR)
def test_columns_that_cannot_be_chosen_are_one_line(names, columns, line):
    with pytest.raises(ImuloopError, match=line):
        resolve(expand(names), columns)
