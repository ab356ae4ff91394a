"""What MATLAB, NetCDF and Parquet files hold beside one table of columns, and what is refused."""

import json
import os
import struct

import h5py
import netCDF4
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import CHANNELS, METADATA_KEY
from imuloop.ingest.reference import read_series
from ingest.written import ACCELERATION, RATE, matlab_5, matlab_7, matlab_73

in_process = pytest.mark.usefixtures("in_process")
BOTH = pytest.mark.parametrize("save", [matlab_5, matlab_73])


@pytest.fixture
def arrays(log):
    columns = {"t": log.t, "acc": log[ACCELERATION], "gyro": log[RATE]}
    return {name: x.to_numpy() for name, x in columns.items()}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.mat"


# --- MATLAB


@in_process
@BOTH
def test_structs_of_columns_are_read_beside_what_is_no_column(log, run, arrays, path, save, same):
    variables = {
        "imu": {"acc": arrays["acc"], "note": "still", "more": {"gyro": arrays["gyro"]}},
        "clock": {"elapsed": log.t.to_numpy(), "rate": 100.0},
        # of other lengths, or none
        "t": np.arange(7.0),
        "temp": 20.0,
        "image": np.zeros((200, 300)),
        "empty": np.empty((0, 0)),
        "remark": "t" * 500,
    }
    save(path, variables)
    done = run(path, columns={"time": "clock.elapsed", "angular_rate": "imu.more.gyro"})
    same(done, log)
    assert "temperature" not in done.samples
    assert done.quality["columns"]["acceleration"] == ["imu.acc.x", "imu.acc.y", "imu.acc.z"]
    assert done.quality["warnings"] == []


def element(kind, content, order="<"):
    return struct.pack(f"{order}II", kind, len(content)) + content + bytes(-len(content) % 8)


@in_process
def test_the_other_byte_order_is_read(log, run, path, same):
    content = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack(">H", 0x100) + b"MI"
    for name in log.columns:
        parts = [(6, struct.pack(">II", 6, 0)), (5, struct.pack(">ii", 500, 1))]
        parts += [(1, name.encode()), (9, log[name].to_numpy().astype(">f8").tobytes())]
        content += element(14, b"".join(element(*part, ">") for part in parts), ">")
    path.write_bytes(content)
    same(run(path), log)


@in_process
def test_text_named_as_matlab_is_read_as_a_table(log, run, path, same):
    log.to_csv(path, index=False, sep="\t")
    done = run(path)
    same(done, log)
    assert "read as a table" in done.quality["warnings"][-1]


def opaque(name, what):
    texts = b"".join(element(1, text.encode()) for text in (name, "MCOS", what))
    matrix = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 6, 1))
    matrix = element(14, matrix + element(1, b"") + element(6, bytes(24)))
    return element(14, element(6, struct.pack("<II", 17, 0)) + texts + matrix)


@in_process
@BOTH
def test_tables_and_timetables_of_matlab_are_named(log, run, arrays, path, save, same):
    def written(variables, what):
        save(path, variables)
        if save is matlab_5:
            path.write_bytes(path.read_bytes() + opaque("T", what))
            return path
        with h5py.File(path, "r+") as file:
            file["T"] = np.zeros((6, 1), "u4")
            file["T"].attrs["MATLAB_class"] = np.bytes_(what)
            file["T"].attrs["MATLAB_object_decode"] = 3
        return path

    line = "T is a MATLAB timetable, which only MATLAB reads: save its columns as variables"
    reasons = run(written({"fs": 100.0}, "timetable")).quality["reasons"]
    assert reasons == [f"the file has no variables of numbers over time; {line}"]
    with pytest.raises(ImuloopError, match=f"no columns of acceleration found .*; {line}"):
        run(written({"gyro": arrays["gyro"]}, "timetable"))
    done = run(written(arrays, "table"))
    same(done, log)
    assert done.quality["warnings"] == [f"left out: {line.replace('timetable', 'table')}"]


@in_process
def test_variables_of_other_lengths_and_names_are_one_line(run, arrays, path):
    matlab_7(path, arrays | {"gyro": arrays["gyro"][:400], "omega": arrays["gyro"]})
    for columns, line in (
        (
            {"angular_rate": "gyro"},
            r"imu/poses: .*log\.mat: columns.angular_rate: gyro.x has 400 rows, acc.x has 500; "
            "name variables of one length",
        ),
        (None, "both look like angular_rate"),
        ({"acceleration": "accel"}, r"columns.acceleration: no column 'accel.x'; there are"),
    ):
        with pytest.raises(ImuloopError, match=line):
            run(path, columns=columns)
    assert run(path, columns={"angular_rate": "omega"}).quality["rows"] == 500


# --- NetCDF


@pytest.fixture
def netcdf(log, tmp_path):
    """Write vectors with an axis, units, a date, and a temperature of which one is missing."""

    def call(units="seconds since 2021-09-20 08:52:00", order=("time", "axis"), kind="f8"):
        # what was read in this process stays open
        path = tmp_path / f"{len([*tmp_path.iterdir()])}.nc"
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
            time = data.createVariable("time", kind, ("time",), fill_value=False)
            time[:], time.units = log.t if kind == "f8" else np.arange(len(log)), units
            temperature = data.createVariable("temperature", "f8", ("time",))
            temperature[:] = np.ma.masked_where(log.index == 9, 20.0 + log.t)
            temperature.units = "C"
        return path

    return call


@in_process
@pytest.mark.parametrize("order", [("time", "axis"), ("axis", "time")])
def test_variables_with_an_axis_units_and_dates_are_read(log, run, netcdf, order):
    done = run(netcdf(order=order))
    np.testing.assert_array_equal(done.samples.ay, log.ay)
    np.testing.assert_allclose(done.samples.gz, 1e-3 * log.gz, rtol=1e-15)
    np.testing.assert_allclose(done.samples.t, log.t, atol=1e-9)
    np.testing.assert_array_equal(done.samples.temperature.isna(), log.index == 9)
    assert done.metadata["start"] == "2021-09-20T08:52:00Z"
    assert done.metadata["units"]["angular_rate"] == "mrad/s"
    assert "1 temperatures are missing" in done.quality["warnings"]
    # whole seconds, and a range of dates
    done = run(netcdf(kind="i8"), time_range=["2021-09-20T08:53", "2021-09-20 08:56:00"])
    assert len(done.samples) == 180 and done.samples.t.iloc[-1] == 179
    assert done.metadata["start"] == "2021-09-20T08:53:00Z"
    assert done.quality["outside_time_range"] == 320
    # days keep nanoseconds
    log["t"] /= 86400
    done = run(netcdf(units="days since 2000-01-01"))
    np.testing.assert_allclose(done.samples.t, np.arange(500) / 100, atol=1e-8)


@in_process
@pytest.mark.parametrize("date", ["0001-13-45", "0001-01-01"])
def test_units_of_time_that_are_no_date_reject_the_log(run, netcdf, date):
    [reason] = run(netcdf(units=f"days since {date}")).quality["reasons"]
    assert reason == f"the stamps, days since {date}, are no dates of the years 1824 to 2115"


@in_process
def test_units_of_variables_that_are_not_known_are_one_line_unless_declared(log, run, netcdf):
    path = netcdf()
    columns = {"acceleration": "acceleration", "angular_rate": "magnetic_density"}
    done = run(path, columns=columns, units={"angular_rate": "rad/s"})
    np.testing.assert_array_equal(done.samples.gx, log.gx)
    with pytest.raises(ImuloopError, match=r"no column 'gyro.x'; there are acceleration.x"):
        run(path, columns={"angular_rate": "gyro"})
    mixed = {"angular_rate": ["angular_velocity.x", "angular_velocity.y", "magnetic_density.z"]}
    with pytest.raises(ImuloopError, match=r"units\.angular_rate: the log says 'mrad/s and uT'"):
        run(path, columns=mixed)
    for unit in ("fortnights", "fortnights since 2021-09-20"):
        path = netcdf(units=unit)
        np.testing.assert_array_equal(run(path, units={"time": "s"}).samples.t, log.t)
        with pytest.raises(ImuloopError, match=r"units\.time: the log says 'fortnights"):
            run(path)


@in_process
def test_six_columns_in_one_variable_are_declared_by_number(log, run, tmp_path):
    path = tmp_path / "log.nc"
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("time", len(log))
        data.createDimension("channel", 6)
        data.createVariable("time", "f8", ("time",))[:] = log.t.to_numpy()
        data.createVariable("imu", "f8", ("time", "channel"))[:] = log.iloc[:, 1:].to_numpy()
        data.createVariable("note", str, ("time",))
        data.createGroup("raw")
    names = [f"imu.{i}" for i in range(6)]
    with pytest.raises(ImuloopError, match=rf"found \(time, {', '.join(names)}\)"):
        run(path)
    columns = {"acceleration": names[:3], "angular_rate": names[3:]}
    np.testing.assert_array_equal(run(path, columns=columns).samples.gz, log.gz)


# --- Parquet


@pytest.fixture
def parquet(tmp_path):
    def call(columns, names=None, metadata=None):
        if names:
            table = pa.Table.from_arrays(columns, names=names)
        else:
            table = pa.table({name: pa.array(x) for name, x in dict(columns).items()})
        pq.write_table(table.replace_schema_metadata(metadata), tmp_path / "log.parquet")
        return tmp_path / "log.parquet"

    return call


def test_what_a_simulated_log_says_of_itself_is_passed_on(log, run, parquet):
    said = {"simulated": True, "units": {"acceleration": "m/s^2", "angular_rate": "deg/s"}}
    path = parquet(log, metadata={b"imuloop": json.dumps(said).encode()})
    done = run(path)
    assert done.metadata["simulated"] is done.quality["simulated"] is True
    np.testing.assert_allclose(done.samples.gz, np.deg2rad(log.gz), rtol=1e-15)
    declared = run(path, units={"angular_rate": "rad/s"})
    assert declared.samples.gz.equals(log.gz)
    line = "units.angular_rate is rad/s, the log says deg/s; rad/s used"
    assert declared.quality["warnings"][0] == line


@pytest.mark.parametrize(("unit", "zone"), [("ms", None), ("us", "Europe/Rome"), ("ns", None)])
def test_dates_are_stamps(log, run, tmp_path, unit, zone):
    moments = pd.Timestamp("2024-03-01T12:00:00", tz="UTC") + pd.to_timedelta(log.t, unit="s")
    moments = pd.Series(moments).dt.round("ms").dt.as_unit(unit)
    log["t"] = moments.dt.tz_convert(zone) if zone else moments.dt.tz_localize(None)
    done = run(log)
    np.testing.assert_array_equal(done.samples.t, np.arange(500) * 10_000_000 * 1e-9)
    assert done.metadata["start"] == "2024-03-01T12:00:00Z"
    assert done.metadata["units"]["time"] == "ISO 8601"


@pytest.mark.parametrize(
    ("column", "values", "words"),
    [("ax", ["text"] * 500, "string, not numbers"), ("t", [[0.0]] * 500, "stamps")],
)
def test_columns_that_hold_no_numbers_are_named(log, run, column, values, words):
    with pytest.raises(ImuloopError, match=rf"column '{column}' holds .*{words}"):
        run(log.assign(**{column: values}))


def test_a_name_that_repeats_is_chosen_by_number(log, run, parquet):
    columns = [pa.array(-log.ax), *(pa.array(log[name]) for name in log)]
    path = parquet(columns, ["ax", *log.columns])
    with pytest.raises(ImuloopError, match=r"both look like acceleration; .* number from 0 to 7"):
        run(path)
    for number, sign in ((0, -1), (2, 1)):
        done = run(path, columns={"acceleration": [number, 3, 4]})
        np.testing.assert_array_equal(done.samples.ax, sign * log.ax)


def test_text_of_numbers_in_a_dictionary_is_stamps(log, run, parquet):
    text = pa.array([f"{t:.2f}" for t in log.t]).dictionary_encode()
    np.testing.assert_array_equal(run(parquet({**log, "t": text})).samples.t, log.t)


# --- files that are none of these


@in_process
@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("log.mat", b"", "the file is no MATLAB file of version 5 or 7.3"),
        ("log.mat", bytes(500), "the file is no MATLAB file of version 5 or 7.3"),
        ("log.mat", b"# Created by Octave 9\n",
         "Octave's text format is not read; save with -v7"),
        ("log.mat", b"MATLAB 5.0".ljust(124) + b"\0\1IM",
         "the file has no variables of numbers over time"),
        ("log.parquet", b"PAR1 and then nothing", "the file is not a whole Parquet file"),
    ],
)  # fmt: skip
def test_other_files_are_rejected(run, tmp_path, name, content, reason):
    (tmp_path / name).write_bytes(content)
    assert run(tmp_path / name).quality["reasons"] == [reason]


def test_damaged_metadata_and_stamps_beyond_64_bits_reject_a_parquet_file(log, run, parquet):
    [reason] = run(parquet(log, metadata={METADATA_KEY: b"[]"})).quality["reasons"]
    assert reason == "the project's metadata in the Parquet file are damaged"
    large = np.uint64(2**63) + np.arange(500, dtype=np.uint64)
    [reason] = run(parquet({**log, "t": large})).quality["reasons"]
    assert reason == "stamps of 2^63 and more are not read"


# --- HDF5 files that would have other files of the machine read

N, SECRET = 500, b"root:x:0:secret!"


@pytest.fixture(params=["log.nc", "log.mat"])
def sound(request, log, tmp_path):
    """Return a sound log to spoil; MATLAB has 512 bytes of its own in front of HDF5."""
    path = tmp_path / request.param
    matlab = path.suffix == ".mat"
    with h5py.File(path, "w", userblock_size=512 * matlab) as file:
        for name in log.columns:
            file[name] = log[name].to_numpy()[None] if matlab else log[name].to_numpy()
        if not matlab:
            file["t"].make_scale("t")
            for name in CHANNELS:
                file[name].dims[0].attach_scale(file["t"])
    if matlab:
        with open(path, "r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")
    return path


def external_storage(group, name, other, shape):
    group.create_dataset(name, shape, "f8", external=[(str(other), 0, 8 * N)])


def external_link(group, name, other, shape):
    group[name] = h5py.ExternalLink(str(other), "/ax")


def virtual(group, name, other, shape):
    layout = h5py.VirtualLayout(shape, "f8")
    layout[:] = h5py.VirtualSource(str(other), "ax", shape)
    group.create_virtual_dataset(name, layout)


def virtual_of_any_length(group, name, other, shape):
    """How long it is, the other file says."""
    longest = (*shape[:-1], None)
    layout = h5py.VirtualLayout(shape, "f8", maxshape=longest)
    more = (*(slice(n) for n in shape[:-1]), slice(0, h5py.h5s.UNLIMITED))
    layout[more] = h5py.VirtualSource(str(other), "ax", shape, maxshape=longest)[more]
    group.create_virtual_dataset(name, layout)


WAYS = {
    external_storage: "external storage",
    external_link: "an external link",
    virtual: "a virtual dataset",
    virtual_of_any_length: "a virtual dataset",
}


@pytest.fixture
def secret(tmp_path):
    """Return two files of the machine: any bytes, and an HDF5 file of the same as numbers."""
    raw, other = tmp_path / "passwd", tmp_path / "other.h5"
    raw.write_bytes(SECRET * (N // 2))
    with h5py.File(other, "w") as file:
        file["ax"] = np.frombuffer(raw.read_bytes())
    return {way: raw if way is external_storage else other for way in WAYS}


def spoil(path, way, other, name="ax", group="/"):
    with h5py.File(path, "r+") as file:
        shape = file["ax"].shape
        place = file.require_group(group)
        place.pop(name, None)
        way(place, name, other, shape)


def refusal(name, way):
    return (
        f"{name} is {WAYS[way]}, whose values lie in another file, which is not read: save the "
        "values themselves in one file"
    )


@in_process
def test_the_log_that_is_spoilt_below_is_sound(run, log, sound):
    np.testing.assert_array_equal(run(sound).samples.gx, log.gx)


@in_process
@pytest.mark.parametrize("way", WAYS)
def test_no_byte_of_another_file_is_read(run, sound, secret, way):
    """Protects all files of a machine that reads a log of somebody else.

    It is refused whether or not the log's variable is used, and no part of it gets into a result;
    nor is it read as attitudes beside a log, in MATLAB files, the second way in.
    """
    spoil(sound, way, secret[way])
    done = run(sound)
    assert done.quality["reasons"] == [refusal("ax", way)]
    assert len(done.samples) == 0
    for file in done.path.parent.iterdir():
        assert SECRET[:8] not in file.read_bytes()
    if sound.suffix == ".mat":
        with pytest.raises(RejectedLog, match=WAYS[way]):
            read_series(sound, None, {"time": "t", "orientation": ["gx"]})


# the walk is the same in both formats
@pytest.mark.parametrize(
    "sound", ["log.nc", pytest.param("log.mat", marks=pytest.mark.study)], indirect=True
)
@pytest.mark.parametrize("way", WAYS)
def test_a_pipe_is_found_behind_other_links_and_not_waited_for(run, sound, tmp_path, way):
    """Protects against opening what is named: the refusal comes before the library opens it.

    And the walk over the links, by which it is found: circles end, a soft link hides nothing.
    """
    os.mkfifo(tmp_path / "pipe")
    spoil(sound, way, tmp_path / "pipe", "more", "group/deeper")
    with h5py.File(sound, "r+") as file:
        del file["ax"]
        file["ax"] = h5py.SoftLink("/group/deeper/more")
        file["around"], file["and_around"] = h5py.SoftLink("/and_around"), h5py.SoftLink("/around")
        file["group/itself"], file["group/above"] = file["group"], file["/"]
    [reason] = run(sound).quality["reasons"]
    assert reason.endswith(refusal("deeper/more", way))


@in_process
def test_a_link_of_a_users_own_kind_is_external(run, sound):
    """Protects against kinds of links that are not known here: 64 is external, above are others."""
    spoil(sound, external_link, "AAAA", "more")
    content = sound.read_bytes()
    # version, flags, kind
    kind = content.index(b"\x40", content.rindex(b"\1", 0, content.index(b"\4more")))
    sound.write_bytes(content[:kind] + b"\x41" + content[kind + 1 :])
    assert run(sound).quality["reasons"] == [refusal("more", external_link)]


@in_process
@pytest.mark.parametrize("sound", ["log.nc"], indirect=True)
def test_a_second_name_within_the_file_is_read(run, log, sound):
    """Protects files that are whole: a soft link is no way out."""
    with h5py.File(sound, "r+") as file:
        file.move("ax", "first")
        file["ax"] = h5py.SoftLink("/first")
    np.testing.assert_array_equal(run(sound).samples.ax, log.ax)
