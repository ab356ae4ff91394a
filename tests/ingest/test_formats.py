"""One round trip per format: the same small log, written in each, comes back bit by bit.

A new format gets a row in `round_trips.yaml`. And what tells a format: its name in the config, a
file's first bytes, its name.
"""

import bz2
import csv
import gzip
import io
import json
import re
from functools import partial
from itertools import product
from pathlib import Path

import netCDF4
import numpy as np
import pandas as pd
import pytest
import yaml
from backports import zstd

from imuloop import config_session
from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS
from imuloop.ingest.formats import (
    FORMATS,
    READERS,
    SIGNATURES,
    find_format,
    guess_format,
    unused_readers,
)
from imuloop.ingest.stamps import stamp_values
from ingest import written
from ingest.phone_forms import zipped

SIX = [*CHANNELS]


def seconds(ns):
    return ns * 1e-9


def us(ns):
    return ns // 1000


def as_type(kind):
    return lambda values: values.astype(kind).astype(float)


def as_text(digits):
    """Numbers as float64 nearest to the text."""
    return np.vectorize(lambda x: float(digits(x)), otypes=[float])


def whole(kind):
    """Values as numbers of an integer type, of 53 bits at most."""
    low, high = (int(np.clip(x, -(2**53), 2**53)) for x in (np.iinfo(kind).min, np.iinfo(kind).max))
    counts = np.random.default_rng(5).integers(low, high, (300, 6), endpoint=True)
    return lambda _: counts.astype(kind)


# --- text

# halfway between two float64, and a little off; longer than any float64; the ends of their range
AWKWARD = """
    1.00000000000000011102230246251565404236316680908203125
    1.00000000000000011102230246251565404236316680908203124
    1.00000000000000033306690738754696212708950042724609375
    9007199254740993 9007199254740992.99999999999999999999999
    0.1000000000000000055511151231257827021181583404541015625
    123456789012345678901234567890.123456789012345678901234567890
    2.2250738585072011e-308 4.9406564584124654e-324 1.7976931348623157e308 1e-400
    -0.000000000000000000000000000000000000000000000000000000000001 0.3e-1 +7 .5 5. 1E+2
""".split()
TEXTS = [(AWKWARD * 2)[i % len(AWKWARD) :][:6] for i in range(300)]


PACKED = {"gz": gzip.compress, "bz2": bz2.compress, "zst": zstd.compress}


def text(folder, stamps, rows, ending="csv", name="timestamp_ns", **dialect):
    file = io.StringIO(newline="")
    writer = csv.writer(file, **dialect)
    writer.writerow([name, *SIX])
    writer.writerows([[stamp, *row] for stamp, row in zip(stamps.tolist(), rows, strict=True)])
    content = file.getvalue().encode()
    pack = PACKED.get(ending[4:], bytes)
    (folder / f"log.{ending}").write_bytes(pack(content))
    return folder / f"log.{ending}"


def numbers(folder, stamps, values, decimal=".", **how):
    rows = [[repr(x).replace(".", decimal) for x in row] for row in values.tolist()]
    return text(folder, stamps, rows, **how)


def awkward(folder, stamps, values, **dialect):
    return text(folder, stamps, TEXTS, **dialect)


def decimal_stamps(folder, stamps, values):
    return numbers(folder, seconds(stamps), values, name="timestamp_s")


def euroc(folder, stamps, values, name="."):
    names = [f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"]
    names += [f"a_RS_S_{axis} [m s^-2]" for axis in "xyz"]
    rows = values[:, [3, 4, 5, 0, 1, 2]].T.tolist()
    content = written.table(["#timestamp [ns]", *names], [stamps.tolist(), *rows])
    (folder / "data.csv").write_text(content)
    (folder / "sensor.yaml").write_text("sensor_type: imu\nrate_hz: 200\n")
    return folder / name


def imu_tk(folder, stamps, values):
    paths = {"acceleration": folder / "acc.mat", "angular_rate": folder / "gyro.mat"}
    for path, three in zip(paths.values(), (values[:, :3], values[:, 3:]), strict=True):
        rows = np.column_stack([seconds(stamps), three]).tolist()
        path.write_text("".join(" ".join(map(repr, row)) + "\n" for row in rows))
    return paths


def phyphox(folder, stamps, values, exact=False):
    how = {"write": repr} if exact else {}
    zipped(path := folder / "log.zip", written.phyphox(frame(seconds(stamps), values), **how))
    return path


def sensor_logger(folder, stamps, values):
    log = frame(seconds(stamps), values)
    named = {"TotalAcceleration": SIX[:3], "Gyroscope": SIX[3:]}
    zipped(path := folder / "log.zip", written.sensor_logger(log, named, stamps=stamps.tolist()))
    return path


# --- arrays


def frame(stamps, values, kind="f8"):
    return pd.DataFrame(values.astype(kind), columns=SIX).assign(t=stamps)


def parquet(folder, stamps, values, kind="f8", packing="snappy"):
    frame(stamps, values, kind).to_parquet(folder / "log.parquet", compression=packing)
    return folder / "log.parquet"


def feather(folder, stamps, values, kind="f8", packing="lz4"):
    table = frame(stamps, values, kind)
    table.to_feather(folder / "log.feather", compression=packing, chunksize=70)
    return folder / "log.feather"


def records(folder, stamps, values, kind="f8", order="<"):
    kinds = {name: order + kind for name in SIX} | {"t": f"{order}i8"}
    table = frame(stamps, values).to_records(False, column_dtypes=kinds)
    np.save(folder / "log.npy", table)
    np.savez(folder / "log.npz", imu=table)
    return folder / f"log.{'npy' if kind == 'f8' else 'npz'}"


def netcdf(folder, stamps, values, kind="f8", variant="NETCDF4"):
    stamps = seconds(stamps) if "CLASSIC" in variant else stamps
    with netCDF4.Dataset(folder / "log.nc", "w", format=variant) as data:
        data.createDimension("time", len(values))
        data.createVariable("time", stamps.dtype, ("time",))[:] = stamps
        for name, column in zip(SIX, values.T, strict=True):
            data.createVariable(name, kind, ("time",))[:] = column
    return folder / "log.nc"


def matlab(folder, stamps, values, save, kind, turned=False):
    values = VALUES[kind](values) if kind[0] != "f" else values.astype(kind)
    three = values[:, :3], values[:, 3:]
    acc, gyro = (x.T if turned else x for x in three)
    getattr(written, save)(folder / "log.mat", {"t": stamps, "acc": acc, "gyro": gyro})
    return folder / "log.mat"


def arrays(folder, stamps, values, save="savez", turned=False):
    three = values[:, :3], values[:, 3:]
    acc, gyro = (x.T if turned else x for x in three)
    getattr(np, save)(
        folder / "log.npz", stamp=stamps, acc=acc, gyro=gyro, rate=100.0, note="still"
    )
    return folder / "log.npz"


def json_lines(folder, stamps, values, nested=False):
    rows = []
    for stamp, row in zip(stamps.tolist(), values.tolist(), strict=True):
        flat = {"t": stamp, "note": 'a, "b"'} | dict(zip(SIX, row, strict=True))
        deep = {"t": stamp, "imu": {"acc": row[:3], "gyro": dict(zip("xyz", row[3:], strict=True))}}
        rows.append(json.dumps(deep if nested else flat))
    (folder / "log.jsonl").write_text("\n".join(rows))
    return folder / "log.jsonl"


# --- vehicles


def ros(folder, stamps, values, kind="bag"):
    return written.bag(folder, kind, {"/imu": (written.IMU, stamps, values)})


def ulog(folder, stamps, values, topic="combined"):
    stamps = us(stamps).astype("u8")
    topics = [written.combined(stamps, values)]
    if topic != "combined":
        topics = [written.px4_sensor("accel", 0, stamps, values[:, :3], 99)]
        topics += [written.px4_sensor("gyro", 0, stamps, values[:, 3:], 55)]
    return written.ulog(folder / "log.ulg", *topics)


KINDS = ("f4", "f8", "i1", "u1", "i2", "u2", "i4", "u8", "i8")
NUMBERS = dict(f="f4", d="f8", B="u1", i="i4", q="i8")
SCALED = dict(c=("i2", 100), L=("i4", 10_000_000))
IMU = "TimeUS,AccX,AccY,AccZ,GyrX,GyrY,GyrZ"


def dataflash(folder, stamps, values, code="d"):
    kind = SCALED.get(code, [NUMBERS.get(code)])[0]
    kept = VALUES[kind](values).tolist()
    rows = [(t, *row) for t, row in zip(us(stamps).tolist(), kept, strict=True)]
    (folder / "log.bin").write_bytes(written.binary(("IMU", ("Q" + 6 * code, IMU), rows)))
    return folder / "log.bin"


# what is kept of stamps and values, by names in `round_trips.yaml`, and by types and codes
EXPONENT = as_text("{:.9E}".format)
STAMPS = {"ns": np.asarray, "us": us, "s": seconds, "s, ten digits": lambda t: EXPONENT(seconds(t))}
VALUES = {"ten digits": EXPONENT, "texts": lambda _: as_text(str)(TEXTS)}
VALUES |= {kind: as_type(kind) if kind[0] == "f" else whole(kind) for kind in KINDS}
VALUES |= {code: VALUES[kind] for code, kind in NUMBERS.items()}
# the float64 nearest to the quotient
VALUES |= {code: lambda x, k=k, s=s: VALUES[k](x) / s for code, (k, s) in SCALED.items()}
ROUND_TRIPS = yaml.safe_load(Path(__file__).with_name("round_trips.yaml").read_text("utf-8"))


def each_way():
    """Yield each writer with its options, and what is kept of stamps and values."""
    for name, way in ROUND_TRIPS.items():
        choices = way.get("each", {})
        for values in product(*choices.values()):
            options = dict(zip(choices, values, strict=True)) | way.get("with", {})
            kept = way.get("values") or options.get("kind") or options.get("code", "f8")
            write = partial(globals()[way["write"]], **options)
            more = STAMPS[way.get("stamps", "ns")], VALUES[kept]
            yield pytest.param(write, *more, id=f"{name} {options or ''}")


@pytest.fixture(scope="module")
def hard():
    """300 rows of six float64 of any mantissa, sign and size, zeros of both signs among them.

    And stamps in ns that no float64 holds, in uneven steps.
    """
    rng = np.random.default_rng(13)
    values = np.ldexp(rng.uniform(-1, 1, (300, 6)), rng.integers(-60, 60, (300, 6)))
    values[0] = 0.1, 1 / 3, -0.0, 0.0, np.nextafter(1, 2), np.nextafter(np.float32(1), 0)
    steps = np.random.default_rng(17).integers(9_000_001, 11_000_001, 300)
    return 1_700_000_000_123_456_789 + np.cumsum(steps), values


@pytest.mark.parametrize(("write", "stamps_kept", "values_kept"), [*each_way()])
def test_every_bit_comes_back(hard, tmp_path, write, stamps_kept, values_kept):
    """Protects all values of a log: none is rounded, cut off, or read as another type's."""
    stamps, values = hard
    path = write(tmp_path, stamps, values)
    paths = path if isinstance(path, dict) else {"log": path}
    _, read = find_format(None, paths)
    table = read(paths, None).batch
    read = np.column_stack([table[name] for name in SIX])
    assert read.dtype == float
    np.testing.assert_array_equal(read.view("u8"), values_kept(values).astype(float).view("u8"))
    times, readable, _ = stamp_values(table["stamp"])
    assert readable.all() and times.dtype == stamps_kept(stamps).dtype
    np.testing.assert_array_equal(times, stamps_kept(stamps))


# --- what tells a format


def test_the_config_names_all_formats():
    assert config_session.FORMATS == (*FORMATS,)


@pytest.mark.parametrize(("head", "name"), SIGNATURES.items())
def test_first_bytes_go_before_the_name(tmp_path, head, name):
    path = tmp_path / "log.csv"
    path.write_bytes(head + bytes(100))
    assert guess_format({"log": str(path)}) == name
    path.write_bytes(head[:-1])
    assert guess_format({"log": str(path)}) == "csv"


def test_the_config_goes_before_all(log, run, tmp_path):
    path = tmp_path / "log.parquet"
    log.to_csv(path, index=False)
    assert run(path, format="csv").quality["log_format"] == "csv"


def test_a_file_that_is_not_there_is_known_by_its_name():
    assert guess_format({"log": "data/of/tomorrow.ULG"}) == "ulog"
    assert guess_format({"acceleration": "a.mat", "angular_rate": "b.mat"}) == "imu_tk"
    with pytest.raises(ImuloopError, match="does not say its format"):
        guess_format({"log": "log.unknown"})


# --- which readers a session depends on

TEXT, BAG = {"delimited"}, {"ros"}
DEPENDS = {
    "text": ({}, {"log": "log.csv.gz"}, TEXT),
    "text on both": ({}, {"acceleration": "a.txt", "angular_rate": "b.txt"}, TEXT),
    "a bag": ({}, {"log": "log.bag"}, BAG),
    "a zip of text tables": ({}, {"log": "log.zip"}, {"phone", "delimited"}),
    "a declared format": ({"format": "ulog"}, {"log": "log.csv"}, {"ulog"}),
    "marks in text": ({}, {"log": "log.bag", "pps": "marks.dat"}, BAG | TEXT),
    "marks in the log": ({"pps": {"counter": "c"}}, {"log": "log.bag"}, BAG | TEXT),
    "a reference": (
        {"reference": {"format": "tsv"}},
        {"log": "a.bag", "reference": "b"},
        BAG | TEXT,
    ),
    "no ending that is known": ({}, {"log": "log.xyz"}, READERS),
}


@pytest.mark.parametrize(("declared", "paths", "readers"), DEPENDS.values(), ids=DEPENDS)
def test_a_session_depends_on_the_readers_of_its_files(declared, paths, readers):
    session = {"format": None, "reference": {}, "pps": {}} | declared
    assert READERS - unused_readers(session, paths) == readers


def test_no_other_module_imports_a_reader(repository):
    """Protects: an edit of a reader reruns each session whose samples may change."""
    imported = {}
    for path in repository.glob("workflow/lib/imuloop/ingest/*.py"):
        imports = re.findall(r"from imuloop\.ingest(?:\.(\w+))? import (.*)", path.read_text())
        names = {name for line in imports for name in re.findall(r"\w+", " ".join(line))}
        imported[path.stem] = names & READERS
    with_text = dict.fromkeys(("pps", "arrays", "json_lines", "phone"), TEXT)
    expected = with_text | {"formats": {"json_lines"}}
    assert {name: readers for name, readers in imported.items() if readers} == expected
