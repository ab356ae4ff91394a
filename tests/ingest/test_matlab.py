"""MATLAB logs of version 5, written by SciPy, and of version 7.3, written by h5py."""

import struct

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from imuloop.core.errors import ImuloopError
from ingest.tables import same

pytestmark = pytest.mark.usefixtures("in_process")
SENSORS = {"acc": ["ax", "ay", "az"], "gyro": ["gx", "gy", "gz"]}


def save_5(path, variables, packed=False):
    savemat(path, variables, do_compression=packed, oned_as="column")


def save_7(path, variables):
    save_5(path, variables, packed=True)


def save_73(path, variables):
    """Save as MATLAB does: its text before HDF5, dimensions backwards, structs as groups."""
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_group("#refs#")
        put_73(file, variables)
    with open(path, "r+b") as file:
        head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 ."
        file.write(head.ljust(116) + bytes(8) + struct.pack("<H", 0x200) + b"IM")


def put_73(group, variables):
    for name, value in variables.items():
        if isinstance(value, dict):
            put_73(group.create_group(name), value)
            group[name].attrs["MATLAB_class"] = np.bytes_("struct")
            continue
        if isinstance(value, str):
            what, value = "char", np.array([[ord(letter) for letter in value]], "u2")
        else:
            value = np.asarray(value)
            value = value[:, None] if value.ndim == 1 else value
            what = {"float64": "double", "float32": "single"}.get(str(value.dtype), value.dtype)
        if value.size:
            packing = {"compression": "gzip"} if value.size > 9 else {}
            dataset = group.create_dataset(name, data=value.T, **packing)
        else:
            dataset = group.create_dataset(name, data=np.array(value.shape, "u8"))
            dataset.attrs["MATLAB_empty"] = 1
        dataset.attrs["MATLAB_class"] = np.bytes_(str(what))


EVERY = pytest.mark.parametrize("save", [save_5, save_7, save_73])
BOTH = pytest.mark.parametrize("save", [save_5, save_73])


@pytest.fixture
def arrays(log):
    return {"t": log.t.to_numpy()} | {name: log[axes].to_numpy() for name, axes in SENSORS.items()}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.mat"


def counts(kind):
    low, high = max(np.iinfo(kind).min, -(2**53)), min(np.iinfo(kind).max, 2**53)
    return np.random.default_rng(0).integers(low, high, (300, 6), kind)


@EVERY
@pytest.mark.parametrize("turned", [False, True])
def test_a_matrix_a_sensor(log, run, arrays, path, save, turned):
    save(path, {name: x.T if turned else x for name, x in arrays.items()})
    done = run(path)
    assert same(done.samples, log)
    assert done.quality["status"] == "ok"
    assert done.quality["warnings"] == []
    assert done.quality["columns"]["angular_rate"] == ["gyro.x", "gyro.y", "gyro.z"]


@EVERY
@pytest.mark.parametrize("kind", ["f4", "f8", "i1", "u2", "i4", "u8"])
def test_every_bit(hard, hard_stamps, every_bit, path, save, kind):
    values = hard.astype(kind) if kind[0] == "f" else counts(kind)
    save(path, {"t": hard_stamps, "acc": values[:, :3], "gyro": values[:, 3:]})
    every_bit(path, values, hard_stamps)


@BOTH
def test_structs_of_columns_beside_others(log, run, arrays, path, save):
    save(
        path,
        {
            "imu": {"acc": arrays["acc"], "note": "still", "more": {"gyro": arrays["gyro"]}},
            "clock": {"elapsed": log.t.to_numpy(), "rate": 100.0},
            # of other lengths, or none
            "t": np.arange(7.0),
            "temp": 20.0,
            "image": np.zeros((200, 300)),
            "empty": np.empty((0, 0)),
            "remark": "t" * 500,
        },
    )
    declared = {"time": "clock.elapsed", "angular_rate": "imu.more.gyro"}
    done = run(path, columns=declared)
    assert same(done.samples, log)
    assert "temperature" not in done.samples
    assert done.quality["columns"]["acceleration"] == ["imu.acc.x", "imu.acc.y", "imu.acc.z"]


def element(kind, content, order="<"):
    return struct.pack(f"{order}II", kind, len(content)) + content + bytes(-len(content) % 8)


def test_the_other_byte_order(log, run, path):
    content = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack(">H", 0x100) + b"MI"
    for name in log.columns:
        parts = [(6, struct.pack(">II", 6, 0)), (5, struct.pack(">ii", 500, 1))]
        parts += [(1, name.encode()), (9, log[name].to_numpy().astype(">f8").tobytes())]
        content += element(14, b"".join(element(*part, ">") for part in parts), ">")
    path.write_bytes(content)
    assert same(run(path).samples, log)


def test_text_is_read_as_a_table(log, run, path):
    log.to_csv(path, index=False, sep="\t")
    done = run(path)
    assert same(done.samples, log)
    assert "read as a table" in done.quality["warnings"][-1]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "the file is no MATLAB file of version 5 or 7.3"),
        (bytes(500), "the file is no MATLAB file of version 5 or 7.3"),
        (b"# Created by Octave 9\n", "Octave's text format is not read; save with -v7"),
        (b"MATLAB 5.0".ljust(124) + b"\0\1IM", "the file has no variables of numbers over time"),
    ],
)
def test_other_files_are_rejected(run, path, content, reason):
    path.write_bytes(content)
    assert run(path).quality["reasons"] == [reason]


def opaque(name, what):
    texts = b"".join(element(1, text.encode()) for text in (name, "MCOS", what))
    matrix = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 6, 1))
    matrix = element(14, matrix + element(1, b"") + element(6, bytes(24)))
    return element(14, element(6, struct.pack("<II", 17, 0)) + texts + matrix)


@BOTH
def test_tables_and_timetables_are_named(log, run, arrays, path, save):
    def add(what):
        save(path, variables)
        if save is save_5:
            path.write_bytes(path.read_bytes() + opaque("T", what))
        else:
            with h5py.File(path, "r+") as file:
                file["T"] = np.zeros((6, 1), "u4")
                file["T"].attrs["MATLAB_class"] = np.bytes_(what)
                file["T"].attrs["MATLAB_object_decode"] = 3

    variables = {"fs": 100.0}
    line = "T is a MATLAB timetable, which only MATLAB reads: save its columns as variables"
    add("timetable")
    reasons = run(path).quality["reasons"]
    assert reasons == [f"the file has no variables of numbers over time; {line}"]
    variables = {"gyro": arrays["gyro"]}
    add("timetable")
    with pytest.raises(ImuloopError, match=f"no columns of acceleration found .*; {line}"):
        run(path)
    variables = arrays
    add("table")
    done = run(path)
    assert same(done.samples, log)
    assert done.quality["warnings"] == [f"left out: {line.replace('timetable', 'table')}"]


def test_lengths_that_differ_and_names_that_are_not_there(run, arrays, path):
    save_7(path, arrays | {"gyro": arrays["gyro"][:400], "omega": arrays["gyro"]})
    line = (
        r"imu/poses: .*log\.mat: columns.angular_rate: gyro.x has 400 rows, acc.x has 500; "
        "name variables of one length"
    )
    with pytest.raises(ImuloopError, match=line):
        run(path, columns={"angular_rate": "gyro"})
    with pytest.raises(ImuloopError, match="both look like angular_rate"):
        run(path)
    assert run(path, columns={"angular_rate": "omega"}).quality["rows"] == 500
    with pytest.raises(ImuloopError, match=r"columns.acceleration: no column 'accel.x'; there are"):
        run(path, columns={"acceleration": "accel"})
