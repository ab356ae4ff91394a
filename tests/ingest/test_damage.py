"""Files that are damaged, or made to break a library, are rejected in one line."""

import h5py
import netCDF4
import pytest
from rosbags import rosbag1

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS


def never_written(path):
    """An array of 24 TB, none of which is in the file."""
    with h5py.File(path, "w") as file:
        file.create_dataset("acc", (3, 1 << 40), "f8", chunks=(3, 1 << 10))


def rows_announced(path):
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("time", 1 << 40)
        for name in CHANNELS:
            data.createVariable(name, "f8", ("time",), chunksizes=(1000,))


def cut_off(path):
    rows_announced(path)
    path.write_bytes(path.read_bytes()[:5000])


TOO_MUCH, BROKEN = "more than 200 times its", r"is no whole file of the format"


@pytest.mark.parametrize(
    ("name", "make", "line"),
    [
        ("log.mat", never_written, TOO_MUCH),
        ("log.nc", rows_announced, TOO_MUCH),
        ("log.nc", cut_off, BROKEN),
        ("log.zip", lambda path: path.write_bytes(b"PK\3\4" + bytes(99)), BROKEN),
        ("log.ulg", lambda path: path.write_bytes(b"ULog\x01\x12\x35" + bytes(30)), "no rows of"),
    ],
)
def test_a_file_that_its_library_cannot_read_is_rejected(run, tmp_path, name, make, line):
    make(tmp_path / name)
    [reason] = run(tmp_path / name).quality["reasons"]
    assert line in reason and reason.isprintable() and len(reason) < 400


def test_the_extra_is_named_where_its_library_is_missing(run, tmp_path, monkeypatch):
    with rosbag1.Writer(tmp_path / "log.bag"):
        pass
    monkeypatch.setitem(__import__("sys").modules, "rosbags", None)
    line = r"needs the package rosbags, .*pip install '\.\[ros\]'"
    with pytest.raises(ImuloopError, match=line):
        run(tmp_path / "log.bag")
