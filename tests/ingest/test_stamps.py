"""Time stamps keep what was written."""

import numpy as np
import pyarrow as pa
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.ingest.stamps import (
    absolute_nanoseconds,
    iso_nanoseconds,
    parse_stamps,
    stamp_array,
    stamp_values,
)

# 2024-02-29T23:59:59 UTC, from the calendar: 19782 days after 1970 and one second less than a day
MOMENT = 19782 * 86400 + 86399


def test_times_of_the_day_are_seconds():
    text = ["23:59:59.250", "0:00:01", "?", "24:61", None]
    values, readable, absolute = stamp_values(parse_stamps(pa.array(text)))
    assert values[:2].tolist() == [86399.25, 1.0]
    assert readable.tolist() == [True, True, False, False, False]
    assert not absolute


def test_whole_numbers_keep_all_digits_beside_unreadable_ones():
    big = 2**60 + 1
    for text in ([str(big)], [str(big), None, "oops", ""]):
        values, readable, absolute = stamp_values(parse_stamps(pa.array(text)))
        assert int(values[0]) == big
        assert readable.tolist() == [True, False, False, False][: len(text)]
        assert not absolute


@pytest.mark.parametrize(
    "text",
    ["2024-02-29T23:59:59", "2024-02-29 23:59:59.000", "2024-02-29T23:59:59Z",
     "2024-03-01T00:59:59+01:00", "2024-02-29T18:59:59.000000000-05:00"],
)  # fmt: skip
def test_dates(text):
    values, readable, absolute = stamp_values(parse_stamps(pa.array([text, "?"])))
    assert values[0] == MOMENT * 10**9
    assert readable.tolist() == [True, False]
    assert absolute
    assert iso_nanoseconds(text) == MOMENT * 10**9


@pytest.mark.parametrize("text", ["yesterday", "now", "10:00", "NaT", ""])
def test_what_is_no_date(text):
    with pytest.raises(ImuloopError, match=f"'{text}' is no ISO 8601 stamp"):
        iso_nanoseconds(text)


@pytest.mark.parametrize("unit", ["us", "s"])
def test_dates_that_nanoseconds_do_not_reach(unit):
    text = ["2024-02-29T23:59:59", "9999-12-31T00:00:00", "0001-01-01T00:00:00"]
    dated = pa.array(np.array(text, f"datetime64[{unit}]"))
    for column in (parse_stamps(pa.array(text)), stamp_array(dated)):
        values, readable, absolute = stamp_values(column)
        assert readable.tolist() == [True, False, False] and absolute
        assert values[0] == MOMENT * 10**9
    for column in (parse_stamps(pa.array(text[1:])), stamp_array(dated[1:])):
        values, readable, absolute = stamp_values(column)
        assert not readable.any() and not values.any() and absolute


def test_unix_time_counts_as_a_date_and_time_since_power_on_does_not():
    assert absolute_nanoseconds(MOMENT, "s", False) == MOMENT * 10**9
    assert absolute_nanoseconds(MOMENT * 10**6 + 1, "us", False) == MOMENT * 10**9 + 1000
    assert absolute_nanoseconds(256551281491968, "us", False) is None
    assert absolute_nanoseconds(np.float64(12.5), "s", False) is None
