"""Logs in memory: arrays and tables of every form, and warnings about their values."""

import warnings

import numpy as np
import pandas as pd
import pytest

import imuloop
from imuloop import ImuloopWarning
from imuloop.core.samples import read_samples

FORCE, TURN = ["ax", "ay", "az"], ["gx", "gy", "gz"]


@pytest.fixture(scope="module")
def log(device):
    return pd.read_csv(device / "1.csv")


def table(t, f, w):
    return pd.DataFrame(np.column_stack([t, f, w]), columns=["t", *FORCE, *TURN])


def freeze(values):
    values = values.copy()
    values.flags.writeable = False
    return values


NUMBERED = {"columns": {"time": 0, "acceleration": [1, 2, 3], "angular_rate": [4, 5, 6]}}
# a log of arrays in another form, and its declarations
FORMS = {
    "lists": lambda t, f, w: ((t.tolist(), f.tolist(), w.tolist()), {}),
    "float32": lambda t, f, w: ((t, f.astype("f4"), w.astype("f4")), {}),
    "long double": lambda t, f, w: ((t, f.astype("g"), w), {}),
    "the other byte order": lambda t, f, w: ((t.astype(">f8"), f.astype(">f8"), w), {}),
    "not contiguous": lambda t, f, w: ((t, np.hstack([f, w])[:, :3], np.asfortranarray(w)), {}),
    "read only": lambda t, f, w: (tuple(map(freeze, (t, f, w))), {}),
    "objects": lambda t, f, w: ((t, f.astype(object), w), {}),
    "whole microseconds": lambda t, f, w: (
        ((1e6 * t).round().astype(int), f, w),
        {"units": {"time": "us"}},
    ),
    "dates": lambda t, f, w: ((pd.to_datetime(t, unit="s"), f, w), {}),
    "other units": lambda t, f, w: (
        (t, f / 9.80665, np.degrees(w)),
        {"units": {"acceleration": "g", "angular_rate": "deg/s"}},
    ),
    "no time": lambda t, f, w: ((None, f, w), {"rate": 50}),
    "sensors by name": lambda t, f, w: ({"t": t, "acceleration": f, "angular_rate": w}, {}),
    "columns by name": lambda t, f, w: (dict(table(t, f, w)), {}),
    "columns of each sensor": lambda t, f, w: (
        {
            "acceleration": dict(table(t, f, w)[["t", *FORCE]]),
            "angular_rate": dict(table(t, f, w)[["t", *TURN]]),
        },
        {},
    ),
    "one array": lambda t, f, w: (np.column_stack([t, f, w]).astype("g"), NUMBERED),
    "time as the index": lambda t, f, w: (table(t, f, w).set_index("t"), {}),
    "notes of several types": lambda t, f, w: (table(t, f, w).assign(a=[1, "b"] * 250), {}),
    "nullable numbers": lambda t, f, w: (table(t, f, w).astype("Float64"), {}),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_log_of_arrays_may_have_any_form(log, form):
    arrays = (log["t"][:500].to_numpy(), log[FORCE][:500].to_numpy(), log[TURN][:500].to_numpy())
    arrays_of, declared = FORMS[form](*arrays)
    samples = imuloop.read(arrays_of, **declared)
    pd.testing.assert_frame_equal(samples, imuloop.read(arrays), rtol=1e-6, atol=1e-6)


def test_masked_values_are_not_read(log):
    force = log[FORCE].to_numpy().copy()
    force[100:110] = np.nan
    masked = np.ma.masked_invalid(force)
    masked.data[100:110] = 9.0
    t, turn = log["t"].to_numpy(), log[TURN].to_numpy()
    with pytest.warns(ImuloopWarning, match="gap"):
        assert len(imuloop.read((t, masked, turn))) == len(log) - 10


def test_a_warning_has_a_category_and_the_line_of_the_call(log, monkeypatch):
    monkeypatch.setattr("imuloop.chain.stages", tuple)
    gap = log.drop(index=range(300, 330))
    for call in (imuloop.read, lambda rows: imuloop.calibrate(rows, progress=False)):
        with pytest.warns(ImuloopWarning, match="1 gap") as raised:
            call(gap)
        of = {w.filename for w in raised if w.category is ImuloopWarning}
        assert of == {__file__}
    with warnings.catch_warnings():
        warnings.simplefilter("error", ImuloopWarning)
        with pytest.raises(ImuloopWarning):
            imuloop.read(gap)


def test_arrays_at_a_rate_need_no_time(log, monkeypatch):
    monkeypatch.setattr("imuloop.chain.stages", tuple)
    arrays = {"acceleration": log[FORCE].to_numpy(), "angular_rate": log[TURN].to_numpy()}
    result = imuloop.calibrate(**arrays, rate=50, progress=False)
    samples = read_samples(result.device.sessions["multi_position_1"]["samples"])
    pd.testing.assert_frame_equal(samples, imuloop.read(log), rtol=1e-6)
