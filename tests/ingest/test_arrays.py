"""Files of arrays that hold more than one table of columns, and files that are refused."""

import json
import os
import re
import struct
from functools import partial

import h5py
import netCDF4
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from imuloop.core.errors import RejectedLog
from imuloop.core.samples import METADATA_KEY
from imuloop.ingest.reference import read_series
from ingest.written import ACCELERATION, RATE, matlab_5, matlab_7, matlab_73

# --- MATLAB


def element(kind, content):
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def opaque(what):
    texts = b"".join(element(1, text.encode()) for text in ("T", "MCOS", what))
    matrix = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 6, 1))
    matrix = element(14, matrix + element(1, b"") + element(6, bytes(24)))
    return element(14, element(6, struct.pack("<II", 17, 0)) + texts + matrix)


def parts(log, *names):
    every = {"t": log.t.to_numpy(), "acc": log[ACCELERATION].to_numpy()}
    every["gyro"] = log[RATE].to_numpy()
    return {name: every[name] for name in names or every}


def structs(path, log, save):
    """Columns in structs, with variables that are not columns or have another length."""
    acc, gyro = parts(log, "acc", "gyro").values()
    save(path, {
        "imu": {"acc": acc, "note": "still", "more": {"gyro": gyro}},
        "clock": {"elapsed": log.t.to_numpy(), "rate": 100.0},
        "t": np.arange(7.0), "temp": 20.0, "image": np.zeros((200, 300)),
        "empty": np.empty((0, 0)), "remark": "t" * 500,
    })  # fmt: skip


def beside_object(path, log, save, names, what="table"):
    save(path, parts(log, *names) if names else {"fs": 100.0})
    if save is matlab_5:
        path.write_bytes(path.read_bytes() + opaque(what))
        return
    with h5py.File(path, "r+") as file:
        file["T"] = np.zeros((6, 1), "u4")
        file["T"].attrs["MATLAB_class"] = np.bytes_(what)
        file["T"].attrs["MATLAB_object_decode"] = 3


def lengths(path, log):
    arrays = parts(log)
    matlab_7(path, arrays | {"gyro": arrays["gyro"][:400], "omega": arrays["gyro"]})


def content(data):
    return lambda path, log: path.write_bytes(data)


# --- NetCDF


def netcdf(path, log, units="seconds since 2021-09-20 08:52:00", order=("time", "axis"), day=1):
    """Write vectors with an axis, units, a date, and a temperature of which one is missing."""
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("time", len(log))
        data.createDimension("axis", 3)
        for name, columns, unit in (
            ("acceleration", ACCELERATION, "m/s2"),
            ("angular_velocity", RATE, "mrad/s"),
            ("magnetic_density", RATE, "uT"),
        ):
            values = log[columns].to_numpy()
            variable = data.createVariable(name, "f8", order)
            variable[:], variable.units = values if order[0] == "time" else values.T, unit
        stamps = log.t.to_numpy() / day if day else np.arange(len(log))
        variable = data.createVariable("time", stamps.dtype, ("time",), fill_value=False)
        variable[:], variable.units = stamps, units
        temperature = data.createVariable("temperature", "f8", ("time",))
        temperature[:] = np.ma.masked_where(log.index == 9, 20.0 + log.t)
        temperature.units = "C"


def coordinate(path, log):
    """A coordinate of no usual name, and six columns in one variable."""
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("obs", len(log))
        data.createDimension("channel", 6)
        data.createVariable("obs", "f8", ("obs",))[:] = log.t.to_numpy()
        data.createVariable("imu", "f8", ("obs", "channel"))[:] = log.iloc[:, 1:].to_numpy()
        data.createVariable("note", str, ("obs",))
        data.createGroup("raw")


# --- Parquet


def parquet(path, log, names=None, metadata=None, **changed):
    columns = {name: pa.array(x) for name, x in (dict(log) | changed).items()}
    arrays = [pa.array(-log.ax), *columns.values()] if names else [*columns.values()]
    table = pa.Table.from_arrays(arrays, names=[*(names or ()), *columns])
    pq.write_table(table.replace_schema_metadata(metadata), path)


def dated(path, log, unit, zone=None):
    moments = pd.Timestamp("2024-03-01T12:00:00", tz="UTC") + pd.to_timedelta(log.t, unit="s")
    moments = pd.Series(moments).dt.round("ms").dt.as_unit(unit)
    parquet(path, log, t=moments.dt.tz_convert(zone) if zone else moments.dt.tz_localize(None))


def with_metadata(content):
    return partial(parquet, metadata={METADATA_KEY: content})


# --- a matrix alone


def matrix(path, log, save, wide=False):
    """Seven columns of time and the sensors, or ten."""
    table = [log.t, log[[*ACCELERATION, *RATE]], np.zeros((len(log), 3 * wide))]
    table = np.column_stack(table)
    save(path, table if save in (np.save, np.savez) else {"data": table})


MATRIX = ((np.save, "npy"), (np.savez, "npz"), (matlab_5, "mat"), (matlab_73, "mat"))
BY_NUMBER = {"columns": {"time": 0, "acceleration": [1, 2, 3], "angular_rate": [4, 5, 6]}}
SAID = json.dumps({"simulated": True, "units": {"angular_rate": "mrad/s"}}).encode()
TEXT = pa.array([f"{i / 100:.2f}" for i in range(500)]).dictionary_encode()
LARGE = np.uint64(2**63) + np.arange(500, dtype=np.uint64)
IN_STRUCTS = {"columns": {"time": "clock.elapsed", "angular_rate": "imu.more.gyro"}}
SIX = [f"imu.{i}" for i in range(6)]
WARM = "1 temperatures are missing"
START, MOMENT = '"start": "2021-09-20T08:52:00Z"', '"start": "2024-03-01T12:00:00Z"'
TABLE = "left out: T is a MATLAB table, which only MATLAB reads: save its columns as variables"
SAVE = {"5": matlab_5, "73": matlab_73}
EVERY = ["t", "acc", "gyro"]
# by a name that ends as the file's: how to write it, the declaration, the scale of the rate, and
# what quality.json says
READ = {
    **{f"structs {i}.mat": (partial(structs, save=x), IN_STRUCTS, 1) for i, x in SAVE.items()},
    **{f"beside a table {i}.mat": (partial(beside_object, save=x, names=EVERY), {}, 1, TABLE)
       for i, x in SAVE.items()},
    "objects.npz": (lambda path, log: np.savez(path, **log, about=np.array({}, dtype=object)), {},
                    1, "left out: about is a pickled object, which is not loaded"),
    "text.mat": (lambda path, log: log.to_csv(path, index=False), {}, 1, "read as a table"),
    "two lengths.mat": (lengths, {"columns": {"angular_rate": "omega"}}, 1),
    "rows.nc": (netcdf, {}, 1e-3, WARM, START),
    "columns.nc": (partial(netcdf, order=("axis", "time")), {}, 1e-3, WARM, START),
    "days.nc": (partial(netcdf, units="days since 2024-03-01T12:00", day=86400), {}, 1e-3, MOMENT),
    "no unit.nc": (partial(netcdf, units="fortnights"), {"units": {"time": "s"}}, 1e-3),
    "another.nc": (netcdf, {"columns": {"angular_rate": "magnetic_density"},
                            "units": {"angular_rate": "rad/s"}}, 1),
    "six.nc": (coordinate, {"columns": {"acceleration": SIX[:3], "angular_rate": SIX[3:]}}, 1),
    "simulated.parquet": (with_metadata(SAID), {}, 1e-3, '"simulated": true'),
    "declared.parquet": (with_metadata(SAID), {"units": {"angular_rate": "rad/s"}}, 1,
                         "units.angular_rate is rad/s, the log says mrad/s; rad/s used"),
    **{f"dates in {unit}.parquet": (partial(dated, unit=unit, zone=zone), {}, 1, MOMENT)
       for unit, zone in (("ms", None), ("us", "Europe/Rome"), ("ns", None))},
    "the second ax.parquet": (partial(parquet, names=["ax"]),
                              {"columns": {"acceleration": [2, 3, 4]}}, 1),
    "text of numbers.parquet": (partial(parquet, t=TEXT), {}, 1),
    **{f"{save.__name__}, declared.{end}": (partial(matrix, save=save, wide=True), BY_NUMBER, 1)
       for save, end in MATRIX},
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_a_log_in_arrays_is_read(log, run, same, tmp_path, name):
    write, declared, scale, *said = READ[name]
    write(tmp_path / name, log)
    done = run(tmp_path / name, **declared)
    log[RATE] = log[RATE] * scale
    # days as float64 hold 1e-8 s
    same(done, log, within=2e-8)
    assert all(part in json.dumps(done.quality) for part in said)


def test_dates_crop_and_missing_temperatures_stay_missing(log, run, tmp_path):
    netcdf(tmp_path / "log.nc", log, day=0)
    done = run(tmp_path / "log.nc", time_range=["2021-09-20T08:53", "2021-09-20 08:56:00"])
    assert len(done.samples) == 180 and done.samples.t.iloc[-1] == 179
    assert done.metadata["start"] == "2021-09-20T08:53:00Z"
    assert done.quality["outside_time_range"] == 320
    done = run(tmp_path / "log.nc")
    np.testing.assert_array_equal(done.samples.temperature.isna(), log.index == 9)


NO_MATLAB = "^the file is not a MATLAB file of version 5 or 7.3"
TIMETABLE = "T is a MATLAB timetable, which only MATLAB reads: save its columns as variables"
MIXED = ["angular_velocity.x", "angular_velocity.y", "magnetic_density.z"]
NONE = "^the file has no variables of numbers over time"
ALONE = f"no columns of acceleration found .*; {TIMETABLE}"
# and refused files: whether the declaration is at fault, and the line
REFUSED = {
    **{f"a timetable {i}.mat": (partial(beside_object, save=x, names=[], what="timetable"), {},
                                False, f"{NONE}; {TIMETABLE}") for i, x in SAVE.items()},
    **{f"beside one {i}.mat": (partial(beside_object, save=x, names=["gyro"], what="timetable"), {},
                               True, ALONE) for i, x in SAVE.items()},
    "lengths.mat": (lengths, {"columns": {"angular_rate": "gyro"}}, True,
                    r"acc.z has 500 rows and gyro.z has 400 rows: name variables of one length"),
    "two.mat": (lengths, {}, True, "both look like angular_rate"),
    "no column.mat": (lengths, {"columns": {"acceleration": "accel"}}, True,
                      r"columns.acceleration: no column 'accel.x'; there are"),
    "empty.mat": (content(b""), {}, False, NO_MATLAB),
    "zeros.mat": (content(bytes(500)), {}, False, NO_MATLAB),
    "octave.mat": (content(b"# Created by Octave 9\n"), {}, False, "save with -v7"),
    "nothing.mat": (content(b"MATLAB 5.0".ljust(124) + b"\0\1IM"), {}, False, NONE),
    **{f"{date}.nc": (partial(netcdf, units=f"days since {date}"), {}, False,
                      f"the stamps, days since {date}, are not dates of the years")
       for date in ("0001-13-45", "0001-01-01")},
    **{f"{unit}.nc": (partial(netcdf, units=unit), {}, True, r"units\.time: the log says 'fortn")
       for unit in ("fortnights", "fortnights since 2021-09-20")},
    "two units.nc": (netcdf, {"columns": {"angular_rate": MIXED}}, True,
                     r"units\.angular_rate: the log says 'mrad/s and uT'"),
    "six.nc": (coordinate, {}, True, rf"found \(obs, {', '.join(SIX)}\)"),
    "text.parquet": (partial(parquet, ax=["text"] * 500), {}, True, "'ax' holds .*, not numbers"),
    "lists.parquet": (partial(parquet, t=[[0.0]] * 500), {}, True, "column 't' holds .*stamps"),
    "two.parquet": (partial(parquet, names=["ax"]), {}, True, "both look .* number from 0 to 7"),
    "metadata.parquet": (with_metadata(b"[]"), {}, False, "is damaged, or not of the format"),
    **{f"{how}.{end}": (partial(matrix, save=save, **more), {}, True, line)
       for save, end in ((np.save, "npy"), (matlab_5, "mat"))
       for how, more, line in (("seven", {}, "no header, 7 columns"),
                               ("wide", {"wide": True}, r"10 columns.*, such as \[1, 2, 3\]"))},
    "torn.parquet": (content(b"PAR1 and nothing"), {}, False, "is damaged, or not of the format"),
    "large.parquet": (partial(parquet, t=LARGE), {}, False, r"stamps of 2\^63 and more are not"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_of_arrays_is_refused_in_one_line(log, refused, tmp_path, name):
    write, declared, error, line = REFUSED[name]
    write(tmp_path / name, log)
    refused(line, tmp_path / name, error=error, **declared)


# --- HDF5 that would have other files of the machine read

WAYS = {
    "external storage": lambda group, name, other: group.create_dataset(
        name, (9,), "f8", external=[(str(other), 0, 72)]),
    "an external link": lambda group, name, other: group.__setitem__(
        name, h5py.ExternalLink(str(other), "/ax")),
    "a virtual dataset": lambda group, name, other: group.create_virtual_dataset(
        name, h5py.VirtualLayout((9,), "f8")),
}  # fmt: skip


def hdf5(path, log, way=None, other="AAAA", group="/"):
    """Write a log, and one way out of the file; MATLAB puts its own 512 bytes in front of HDF5."""
    matlab = path.suffix == ".mat"
    with h5py.File(path, "w", userblock_size=512 * matlab) as file:
        for name in log.columns:
            file[name] = log[name].to_numpy()[None] if matlab else log[name].to_numpy()
            if not matlab:
                file["t"].make_scale("t") if name == "t" else file[name].dims[0].attach_scale(
                    file["t"]
                )
        if way:
            WAYS[way](file.require_group(group), "more", other)
            # circles, in which the walk over all links ends
            file["around"], file["and_around"] = h5py.SoftLink("/and_around"), h5py.SoftLink("/ar")
            file["itself"] = file["/"]
        elif not matlab:
            # a second name within the file does not lead out
            file.move("ax", "first")
            file["ax"] = h5py.SoftLink("/first")
    if matlab:
        with open(path, "r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ["log.nc", "log.mat"])
def test_no_other_file_is_opened(log, run, same, tmp_path, name, way):
    """Protects the files of a machine that reads an unknown log: a pipe would be waited for.

    A log that holds a reference is the second way in.
    """
    hdf5(tmp_path / name, log)
    same(run(tmp_path / name), log)
    os.mkfifo(tmp_path / "pipe")
    hdf5(tmp_path / name, log, way, tmp_path / "pipe", "group/deeper")
    done = run(tmp_path / name)
    line = "the values of .*group/deeper/more lie in another file, which is not read"
    assert re.match(line, done.quality["reasons"][0]) and len(done.samples) == 0
    if name == "log.mat":
        with pytest.raises(RejectedLog, match=line):
            read_series(tmp_path / name, None, {"time": "t", "orientation": ["gx"]})


def test_a_link_of_a_users_own_kind_leads_out(log, refused, tmp_path):
    """Protects against kinds of links that are not known here: 64 is external, above are others."""
    hdf5(path := tmp_path / "log.nc", log, "an external link", group="g")
    data = path.read_bytes()
    # version, flags, kind
    kind = data.index(b"\x40", data.rindex(b"\1", 0, data.index(b"\4more")))
    path.write_bytes(data[:kind] + b"\x41" + data[kind + 1 :])
    refused("the values of g/more lie in another file", path, error=False)
