"""Figures of quality.json in a table of cases."""

import pytest


def check_figures(quality, figures):
    """Check figures by their paths, such as "gaps.list.0.start_s"; * stands for all at its place.

    What is expected is a value, bounds such as "> 1", "< 1" and "0.9 .. 1.1", or a function that
    tells whether a value is right.
    """
    for path, expected in figures.items():
        values = [quality]
        for key in path.split("."):
            values = [member for value in values for member in _members(value, key)]
        assert all(_is(value, expected) for value in values), (path, values, expected)


def _members(value, key):
    if key == "*":
        return value.values()
    return [value[int(key) if key.isdigit() else key]]


def _is(value, expected):
    if callable(expected):
        return expected(value)
    if isinstance(expected, str) and " .. " in expected:
        low, high = map(float, expected.split(" .. "))
        return low < value < high
    if isinstance(expected, str) and expected[0] in "<>":
        sign, limit = expected.split()
        return value > float(limit) if sign == ">" else value < float(limit)
    return value == (pytest.approx(expected) if isinstance(expected, float) else expected)
