"""What MATLAB's files hold beside one table of columns, and what is no such file."""

import struct

import h5py
import numpy as np
import pytest

from imuloop.core.errors import ImuloopError
from ingest.written import ACCELERATION, RATE, matlab_5, matlab_7, matlab_73

BOTH = pytest.mark.parametrize("save", [matlab_5, matlab_73])


@pytest.fixture
def arrays(log):
    columns = {"t": log.t, "acc": log[ACCELERATION], "gyro": log[RATE]}
    return {name: x.to_numpy() for name, x in columns.items()}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.mat"


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


def test_the_other_byte_order_is_read(log, run, path, same):
    content = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack(">H", 0x100) + b"MI"
    for name in log.columns:
        parts = [(6, struct.pack(">II", 6, 0)), (5, struct.pack(">ii", 500, 1))]
        parts += [(1, name.encode()), (9, log[name].to_numpy().astype(">f8").tobytes())]
        content += element(14, b"".join(element(*part, ">") for part in parts), ">")
    path.write_bytes(content)
    same(run(path), log)


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
