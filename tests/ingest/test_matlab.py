"""MATLAB logs of version 5, written by SciPy, and of version 7.3, written by h5py."""

import io
import struct
import zlib

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from imuloop.core.errors import ImuloopError
from imuloop.ingest.formats import guess_format

NOT_WHOLE = ["the file is not a whole MATLAB file"]
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


@pytest.fixture
def arrays(log):
    """The log as a time and a matrix a sensor."""
    return {"t": log.t.to_numpy()} | {name: log[axes].to_numpy() for name, axes in SENSORS.items()}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.mat"


def same(samples, log, kind=float):
    for name in log.columns:
        np.testing.assert_array_equal(samples[name], log[name].astype(kind))
    return True


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
def test_single_precision_and_whole_nanoseconds(log, run, arrays, path, save):
    stamps = 1_700_000_000_123_456_789 + 10_000_000 * np.arange(500)
    save(path, {name: x.astype("f4") for name, x in arrays.items()} | {"t": stamps})
    done = run(path, units={"time": "ns"})
    assert same(done.samples, log.drop(columns="t"), np.float32)
    np.testing.assert_array_equal(done.samples.t, 10_000_000 * np.arange(500) * 1e-9)
    assert done.metadata["start"] == "2023-11-14T22:13:20.123456789Z"


@EVERY
@pytest.mark.parametrize("kind", ["f4", "f8"])
def test_every_bit(hard, hard_stamps, every_bit, path, save, kind):
    values = hard.astype(kind)
    save(path, {"t": hard_stamps, "acc": values[:, :3], "gyro": values[:, 3:]})
    every_bit(path, values, hard_stamps)


@EVERY
@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"])
def test_counts_of_every_type(run, arrays, path, save, kind):
    rng = np.random.default_rng(0)
    low, high = np.iinfo(kind).min, np.iinfo(kind).max
    counts = rng.integers(max(low, -(2**53)), min(high, 2**53), (500, 3), kind)
    save(path, arrays | {"acc": counts})
    # a power of two, which no count loses a bit by
    scale = 2.0**-32
    done = run(path, units={"acceleration": "count"}, nominal={"acceleration": {"scale": scale}})
    np.testing.assert_array_equal(done.samples[["ax", "ay", "az"]], counts * scale)


@EVERY
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


@EVERY
def test_a_matrix_of_all_columns(log, run, path, save):
    save(path, {"data": log.to_numpy()})
    numbers = {"acceleration": [1, 2, 3], "angular_rate": [4, 5, 6]}
    columns = {q: [f"data.{i}" for i in three] for q, three in numbers.items()}
    assert same(run(path, columns={"time": "data.0", **columns}).samples, log)


@EVERY
def test_batches_do_not_matter(run, arrays, path, save):
    save(path, arrays | {"temp": np.linspace(20, 21, 500)})
    done = run(path)
    assert done.samples.temperature.iloc[-1] == 21
    assert done.path.read_bytes() == run(path, batch_rows=9).path.read_bytes()


def test_the_other_byte_order(log, run, path):
    def element(kind, content):
        return struct.pack(">II", kind, len(content)) + content + bytes(-len(content) % 8)

    content = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack(">H", 0x100) + b"MI"
    for name in log.columns:
        parts = [(6, struct.pack(">II", 6, 0)), (5, struct.pack(">ii", 500, 1))]
        parts += [(1, name.encode()), (9, log[name].to_numpy().astype(">f8").tobytes())]
        content += element(14, b"".join(element(*part) for part in parts))
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
        (bytes(512) + b"\x89HDF\r\n\x1a\n" + bytes(900), NOT_WHOLE[0]),
    ],
)
def test_other_files_are_rejected(run, path, content, reason):
    path.write_bytes(content)
    assert run(path).quality["reasons"] == [reason]


def opaque(name, what):
    """Return a MATLAB object as version 5 keeps it."""

    def element(kind, content):
        return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)

    texts = b"".join(element(1, text.encode()) for text in (name, "MCOS", what))
    return element(14, element(6, struct.pack("<II", 17, 0)) + texts + element(6, bytes(24)))


@pytest.mark.parametrize("save", [save_5, save_73])
def test_tables_and_timetables_are_told(log, run, arrays, path, save):
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
    line = line.replace("timetable", "table")
    assert done.quality["warnings"] == [f"left out: {line}"]


@EVERY
def test_lengths_that_differ_and_names_that_are_not_there(run, arrays, path, save):
    save(path, arrays | {"gyro": arrays["gyro"][:400], "omega": arrays["gyro"]})
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


def test_without_time_a_rate_is_needed(log, run, arrays, path):
    del arrays["t"]
    save_5(path, arrays)
    with pytest.raises(ImuloopError, match="no time column"):
        run(path)
    assert same(run(path, rate=100).samples, log.drop(columns="t"))


def test_one_file_is_matlab_and_two_are_imu_tk():
    assert guess_format({"log": "some.mat"}) == "matlab"
    assert guess_format({"acceleration": "a.mat", "angular_rate": "g.mat"}) == "imu_tk"


@EVERY
@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.99, 0.9999])
def test_truncated_files_are_rejected(run, arrays, path, save, share):
    save(path, arrays)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    assert len(run(path).quality["reasons"]) == 1


@EVERY
def test_mutated_files_are_read_or_rejected(run, arrays, path, save):
    rng = np.random.default_rng(5)
    save(path, {"imu": {"acc": arrays["acc"], "gyro": arrays["gyro"]}, "t": arrays["t"]})
    content = path.read_bytes()
    for _ in range(60):
        damaged = bytearray(content)
        # where the structure is, more often than in the numbers
        size = 3000 if rng.random() < 0.7 else len(damaged)
        for at in rng.integers(0, size, rng.integers(1, 6)):
            damaged[at] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            assert run(path).quality["status"] in ("ok", "rejected")
        except ImuloopError as error:
            assert "\n" not in str(error)


def matrix(kind, shape, content=b"", name=b"a"):
    parts = [struct.pack("<IIII", 6, 8, kind, 0)]
    parts += [struct.pack("<IIii", 5, 8, *shape), struct.pack("<II", 1, len(name))]
    parts += [name, bytes(-len(name) % 8), content]
    body = b"".join(parts)
    return struct.pack("<II", 14, len(body)) + body


def test_hostile_files_take_neither_stack_nor_memory(run, arrays, path):
    save_5(path, arrays)
    sound = path.read_bytes()
    nested = matrix(1, (1, 1))
    for _ in range(3000):
        nested = matrix(1, (1, 1), nested, b"")
    structs = matrix(6, (1, 1), name=b"")
    for _ in range(300):
        fields = struct.pack("<IiII", 5 | 4 << 16, 8, 1, 8) + b"s".ljust(8, b"\0")
        structs = matrix(2, (1, 1), fields + structs, b"")
    for hostile in (nested, structs, matrix(1, (1 << 28, 1)), matrix(5, (1 << 30, 1 << 30))):
        # what holds no numbers is passed over
        path.write_bytes(sound + hostile)
        assert run(path).quality["status"] == "ok"
    for hostile in (matrix(6, (1 << 28, 1)), matrix(6, (3, 1), struct.pack("<II", 9, 1 << 30))):
        path.write_bytes(sound + hostile)
        assert run(path).quality["reasons"] == NOT_WHOLE


def test_a_bomb_is_refused(run, arrays, path):
    zeros = io.BytesIO()
    savemat(zeros, {"a": np.zeros(1 << 20)})
    small = zlib.compress(zeros.getvalue()[128:], 9)
    save_5(path, {"t": arrays["t"][:9]})
    path.write_bytes(path.read_bytes() + struct.pack("<II", 15, len(small)) + small)
    [reason] = run(path).quality["reasons"]
    assert reason.startswith("unpacked, the file is more than 200 times its ")
    with h5py.File(path, "w") as file:
        # never written, so the file holds none of it
        file.create_dataset("a", (3, 1 << 40), "f8", chunks=(3, 1 << 10))
    assert run(path).quality["reasons"][0].startswith("unpacked, the file is more than 200 times")


def test_no_other_file_is_followed(run, arrays, path, tmp_path):
    save_73(tmp_path / "other.mat", arrays)
    arrays["t"].tofile(tmp_path / "raw.bin")
    with h5py.File(path, "w") as file:
        file["acc"] = h5py.ExternalLink("other.mat", "acc")
        file["gyro"] = h5py.SoftLink("/loop")
        file["loop"] = h5py.SoftLink("/gyro")
        layout = h5py.VirtualLayout((1, 500), "f8")
        layout[:] = h5py.VirtualSource(tmp_path / "other.mat", "t", (1, 500))
        file.create_virtual_dataset("virtual", layout)
        outside = [(str(tmp_path / "raw.bin"), 0, 4000)]
        file.create_dataset("outside", (1, 500), "f8", external=outside)
        file.create_group("group")["itself"] = file["/"]
    reason = "a link leads out of the file ('acc' in the file): refused"
    assert run(path).quality["reasons"] == [reason]


def test_stamps_of_64_bits_without_sign(log, run, tmp_path):
    column = {name: log[name].to_numpy()[:, None] for name in log.columns}
    path = tmp_path / "log.mat"
    for origin in (2**40, 2**63):
        column["t"] = np.uint64(origin) + 10 * np.arange(500, dtype=np.uint64)[:, None]
        savemat(path, column)
        quality = run(path, units={"time": "ms"}).quality
        if origin == 2**40:
            assert quality["status"] == "ok"
        else:
            assert quality["reasons"] == ["stamps of 2^63 and more are not read"]
