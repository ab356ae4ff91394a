"""Small sound logs of every format, and a config."""

import gzip
import io
import json
import struct
import zipfile

import h5py
import netCDF4
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

# a fifth more than a log needs: rows take time
ROWS = 120
SIX = "ax ay az gx gy gz".split()
STAMP = 1_700_000_000 * 10**9


def all_seeds(folder):
    """Return kind -> [(file name, content)] of sound logs."""
    rng = np.random.default_rng(0)
    log = pd.DataFrame({"t": np.arange(ROWS) / 50})
    log[SIX] = rng.normal([0.1, -0.2, 9.8, 0, 0, 0.01], 0.01, size=(ROWS, 6)).round(5)
    text = log.to_csv(index=False).encode()
    dated = log.assign(t=pd.Timestamp("2024-01-01") + pd.to_timedelta(log.t, "s"), temp=20.5)
    return {
        "csv": [
            ("log.csv", text),
            ("log.txt", log.to_csv(index=False, sep=" ", header=False).encode()),
            ("log.csv", log.to_csv(index=False, sep=";", decimal=",").encode()),
            ("log.tsv", b"# made by a logger\n" + dated.to_csv(index=False, sep="\t").encode()),
            ("log.csv.gz", text),
            ("log.csv", b"\xef\xbb\xbf" + text.replace(b"\n", b"\r\n")),
            ("log.csv", sensorlog(log)),
        ],
        "packed": [("log.csv.gz", gzip.compress(text, mtime=0))],
        "ulog": [("log.ulg", ulog(log, topics)) for topics in TOPICS],
        "matlab": [("log.mat", each) for each in matlab(log)],
        "zip": [("log.zip", phyphox(log)), ("log.zip", sensor_logger(log))],
        "ros": [(f"log.{kind}", bag(folder, log, kind, packing)) for kind, packing in BAGS],
        "dataflash": [("log.bin", dataflash(log)), ("log.bin", dataflash_text(log))],
        "table": [
            *(("log.parquet", each) for each in parquet(log)),
            *(("log.nc", each) for each in netcdf(folder, log)),
        ],
        "config": [("config.yaml", json.dumps(CONFIG).encode())],
    }


CONFIG = {
    "defaults": {"gravity": {"latitude": 45.4, "height": 12}, "segment": {}, "diagnose": {}},
    "mirror": ".",
    "devices": {
        "imu": {
            "label": "My IMU",
            "gravity": 9.8,
            "full_scale": {"acceleration": 78.5, "angular_rate": 34.9},
            "nominal": {"acceleration": {"scale": 0.0024, "offset": 32768}},
            "sessions": {
                "a": {
                    "kind": "static",
                    "format": "csv",
                    "file": "log.csv",
                    "columns": {"time": "t", "acceleration": ["ax", "ay", "az"]},
                    "units": {"time": "s", "acceleration": "m/s^2", "angular_rate": "deg/s"},
                    "rate": 100,
                    "time_range": [0, 10],
                },
                "b": {
                    "kind": "six_position",
                    "file": {"url": "https://a/b.csv", "sha256": "0" * 64},
                },
                "c": {"kind": "static", "file": {"acceleration": "a.mat", "angular_rate": "b.mat"}},
            },
        }
    },
}


# of two topics, of buffers and of increments: layout, and a row's fields from its seven numbers
ACCEL = b"sensor_accel:uint64_t timestamp;uint64_t timestamp_sample;float x;float y;float z;"
FIFO = b"sensor_accel_fifo:uint64_t timestamp;uint64_t timestamp_sample;float dt;float scale;"
FIFO += b"uint8_t samples;int16_t[4] x;int16_t[4] y;int16_t[4] z;"
DELTA = b"vehicle_imu:uint64_t timestamp;float[3] delta_angle;float[3] delta_velocity;"
DELTA += b"uint32_t delta_angle_dt;uint16_t delta_velocity_dt;"
BOTH = b"sensor_combined:uint64_t timestamp;float[3] gyro_rad;"
BOTH += b"int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;"


def fifo_row(t, a, w):
    return struct.pack("<QQffB12h", t, t - 9, 50, 0.01, 4, *range(12))


TOPICS = (
    [(BOTH, lambda t, a, w: struct.pack("<Q3fi3f", t, *w, 5, *a))],
    [
        (ACCEL, lambda t, a, w: struct.pack("<QQ3f", t, t - 9, *a)),
        (ACCEL.replace(b"accel", b"gyro"), lambda t, a, w: struct.pack("<QQ3f", t, t - 7, *w)),
    ],
    [(FIFO, fifo_row), (FIFO.replace(b"accel", b"gyro"), fifo_row)],
    [(DELTA, lambda t, a, w: struct.pack("<Q6fIH", t, *w, *a, 20000, 20000))],
)


def ulog(log, topics):
    def message(kind, body):
        return struct.pack("<HB", len(body), ord(kind)) + body

    content = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000) + message("B", bytes(40))
    content += b"".join(message("F", layout) for layout, _ in topics)
    content += message("I", b"\x0echar[3] sys_namPX4") + message("P", b"\x09int32_t a\1\0\0\0")
    for number, (layout, _) in enumerate(topics):
        content += message("A", struct.pack("<BH", 0, number) + layout.partition(b":")[0])
    content += message("L", b"6" + bytes(8) + b"ready") + message("O", b"\x0a\0")
    for t, *axes in log[["t", *SIX]].to_numpy():
        for number, (_, pack) in enumerate(topics):
            row = pack(int(t * 1e6) + 1000, axes[:3], axes[3:])
            content += message("D", struct.pack("<H", number) + row)
    return content


def matlab(log):
    variables = {"t": log.t.to_numpy(), "acc": log[SIX[:3]].to_numpy()}
    variables |= {"gyro": log[SIX[3:]].to_numpy(), "imu": {"note": "x", "temp": np.ones(ROWS)}}
    for packed in (False, True):
        file = io.BytesIO()
        savemat(file, variables, do_compression=packed)
        # its first text says when it was made
        yield b"MATLAB 5.0 MAT-file".ljust(116) + file.getvalue()[116:]
    head = b"MATLAB 7.3 MAT-file".ljust(124) + struct.pack("<H", 0x200) + b"IM"
    for odd in (False, True):
        file = io.BytesIO()
        with h5py.File(file, "w", userblock_size=512) as store:
            for name in ("t", "acc", "gyro"):
                data = np.atleast_2d(variables[name].T)
                made = store.create_dataset(name, data=data, compression="gzip" if odd else None)
                made.attrs["MATLAB_class"] = np.bytes_("double")
            if odd:
                for name, dtype in ODD_TYPES.items():
                    store.create_dataset(f"odd/{name}", shape=(1, ROWS), dtype=dtype)
                store["odd/soft"], store["odd/round"] = h5py.SoftLink("/t"), store["odd"]
                store["odd/inside"] = h5py.ExternalLink("log.mat", "/")
                store.create_dataset("large", shape=(1, 1 << 40), dtype="f8", chunks=(1, 64))
        yield head + file.getvalue()[len(head) :]


ODD_TYPES = {
    "text": h5py.string_dtype(),
    "reference": h5py.ref_dtype,
    "half": ">f2",
    "record": [("x", "f8"), ("y", "i4")],
    "row": h5py.vlen_dtype("f8"),
    "kind": h5py.enum_dtype({"a": 1}),
}


def zipped(members, packing=zipfile.ZIP_STORED):
    """Return a zip of texts by name, whose dates are always the same."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", packing) as archive:
        for name, text in members.items():
            archive.writestr(zipfile.ZipInfo(name), text, packing)
    return file.getvalue()


def phyphox(log):
    members = {"meta/device.csv": '"property","value"\n"deviceModel","A phone"\n'}
    for name, kind, unit, axes in (
        ("Accelerometer.csv", "Acceleration", "m/s^2", SIX[:3]),
        ("Gyroscope.csv", "Gyroscope", "rad/s", SIX[3:]),
    ):
        header = ["Time (s)", *(f"{kind} {axis} ({unit})" for axis in "xyz")]
        members[name] = log[["t", *axes]].to_csv(index=False, header=header)
    return zipped(members)


def sensor_logger(log):
    members = {"Metadata.csv": "device name,platform,standardisation\nA phone,ios,false\n"}
    for name, axes, factor in (
        # what is left without gravity
        ("Accelerometer", SIX[:3], 0.001),
        ("TotalAcceleration", SIX[:3], 1),
        ("GyroscopeUncalibrated", SIX[3:], 1),
    ):
        table = factor * log[axes].set_axis(["x", "y", "z"], axis=1)
        table.insert(0, "time", STAMP + (log.t * 1e9).astype("int64"))
        table.insert(1, "seconds_elapsed", log.t)
        members[f"{name}.csv"] = table.to_csv(index=False)
    return zipped(members, zipfile.ZIP_DEFLATED)


def sensorlog(log):
    table = pd.DataFrame({"loggingTime(txt)": pd.Timestamp("2024-01-01")}, index=log.index)
    for sensor, column, unit, axes in (
        ("accelerometer", "accelerometerAcceleration", "G", SIX[:3]),
        ("gyro", "gyroRotation", "rad/s", SIX[3:]),
    ):
        table[f"{sensor}Timestamp_sinceReboot(s)"] = log.t
        for letter, axis in zip("XYZ", axes, strict=True):
            # its G is standard gravity
            table[f"{column}{letter}({unit})"] = log[axis] / (9.80665 if unit == "G" else 1)
    return table.to_csv(index=False).encode()


BAGS = (("bag", None), ("bag", "BZ2"), ("bag", "LZ4"), ("mcap", None), ("mcap", "ZSTD"))
BAGS += (("db3", None),)


def bag(folder, log, kind, packing):
    first = kind == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    types, name = store.types, "sensor_msgs/msg/Imu"
    path = folder / f"seed_{kind}_{packing}"
    if first:
        writer = rosbag1.Writer(path)
        if packing:
            writer.set_compression(writer.CompressionFormat[packing])
    else:
        plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        if packing:
            modes = rosbag2.CompressionMode, rosbag2.CompressionFormat
            writer.set_compression(modes[0].STORAGE, modes[1][packing])
    vector, unknown = types["geometry_msgs/msg/Vector3"], np.zeros(9)
    turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    write = store.serialize_ros1 if first else store.serialize_cdr
    with writer:
        connection = writer.add_connection("/imu", name, typestore=store)
        for t, *axes in log[["t", *SIX]].to_numpy():
            stamp = STAMP + int(t * 1e9)
            moment = types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
            more = {"seq": 0} if first else {}
            header = types["std_msgs/msg/Header"](stamp=moment, frame_id="imu", **more)
            message = types[name](
                header, turn, unknown, vector(*axes[3:]), unknown, vector(*axes[:3]), unknown
            )
            writer.write(connection, stamp, write(message, name))
    return (path if first else next(path.glob(f"*.{kind}"))).read_bytes()


NAMES = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
DEFINITIONS = (
    (128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
    (144, 36, "IMU", "QBffffff", NAMES),
)


def dataflash(log):
    content = b""
    for number, size, *texts in DEFINITIONS:
        texts = (text.encode() for text in texts)
        content += struct.pack("<3BBB4s16s64s", 0xA3, 0x95, 0x80, number, size, *texts)
    for t, *axes in log[["t", *SIX[3:], *SIX[:3]]].to_numpy():
        content += struct.pack("<3BQB6f", 0xA3, 0x95, 144, int(t * 1e6), 0, *axes)
    return content


def dataflash_text(log):
    lines = [", ".join(["FMT", *map(str, each)]) for each in DEFINITIONS]
    for t, *axes in log[["t", *SIX[3:], *SIX[:3]]].to_numpy():
        lines.append(", ".join(["IMU", str(int(t * 1e6)), "0", *map(str, axes)]))
    return "\n".join(lines).encode()


def parquet(log):
    dates = log.assign(t=pd.Timestamp("2024-01-01", tz="UTC") + pd.to_timedelta(log.t, "s"))
    odd = dates.assign(ay=None, gx=[[1.0]] * ROWS, gy=[{"a": 1}] * ROWS, gz=pd.Categorical(log.gz))
    missing = log.where(log.ax > 0.1).astype("float32").assign(t=(log.t * 1e9).astype("int64"))
    for table, options in (
        (log, {"compression": "gzip", "data_page_version": "2.0"}),
        (dates, {"compression": "zstd", "row_group_size": 7}),
        (odd, {"compression": "snappy"}),
        (missing, {"compression": "lz4", "use_dictionary": False}),
    ):
        file = io.BytesIO()
        table = pa.Table.from_pandas(table, preserve_index=False)
        said = {b"imuloop": b'{"units": {"time": "s", "acceleration": "m/s^2"}, "simulated": true}'}
        pq.write_table(table.replace_schema_metadata(said), file, **options)
        yield file.getvalue()


def netcdf(folder, log):
    for kind in ("NETCDF4", "NETCDF3_CLASSIC", "odd"):
        odd = kind == "odd"
        with netCDF4.Dataset(folder / "seed.nc", "w", format="NETCDF4" if odd else kind) as data:
            data.createDimension("time", None if odd else ROWS)
            data.createDimension("axis", 3)
            for name in log.columns:
                data.createVariable(name, "f8", ("time",), zlib=odd)[:] = log[name].to_numpy()
            if odd:
                data["t"].units = "days since 0001-13-45"
                data["ax"].setncatts({"scale_factor": "x", "add_offset": np.nan, "units": 5})
                data["ay"].setncatts({"missing_value": "no", "valid_range": [1.0, 0.0]})
                data.createVariable("counts", "i2", ("time", "axis"), fill_value=-1)[:] = 7
                data.createGroup("more").createVariable("gyr", "f4", ("time", "axis"))[:] = 1
        yield (folder / "seed.nc").read_bytes()
