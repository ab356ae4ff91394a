"""Small sound logs of every format, and a config."""

import gzip
import io
import json
import struct
import zipfile

import h5py
import numpy as np
import pandas as pd
from scipy.io import savemat

ROWS = 150
SIX = "ax ay az gx gy gz".split()


def all_seeds(folder):
    """Return kind -> [(file name, content)] of sound logs."""
    rng = np.random.default_rng(0)
    log = pd.DataFrame({"t": np.arange(ROWS) / 50})
    log[SIX] = rng.normal([0.1, -0.2, 9.8, 0, 0, 0.01], 0.01, size=(ROWS, 6)).round(5)
    text = log.to_csv(index=False)
    dated = log.assign(t=pd.Timestamp("2024-01-01") + pd.to_timedelta(log.t, "s"), temp=20.5)
    return {
        "csv": [
            ("log.csv", text.encode()),
            ("log.txt", log.to_csv(index=False, sep=" ", header=False).encode()),
            ("log.csv", log.to_csv(index=False, sep=";", decimal=",").encode()),
            ("log.tsv", b"# made by a logger\n" + dated.to_csv(index=False, sep="\t").encode()),
            ("log.csv.gz", text.encode()),
        ],
        "packed": [("log.csv.gz", gzip.compress(text.encode()))],
        "ulog": [("log.ulg", ulog(log))],
        "matlab": [("log.mat", each) for each in matlab(log)],
        "zip": [("log.zip", phyphox(log))],
        "ros": [(f"log.{kind}", ros(folder, log, kind)) for kind in ("bag", "mcap", "db3")],
        "dataflash": [("log.bin", dataflash(log)), ("log.bin", dataflash_text(log))],
        "table": [("log.parquet", parquet(log)), ("log.nc", netcdf(folder, log))],
        "config": [("config.yaml", json.dumps(CONFIG).encode())],
    }


HASH = "0" * 64
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
                "b": {"kind": "six_position", "file": {"url": "https://a/b.csv", "sha256": HASH}},
                "c": {"kind": "static", "file": {"acceleration": "a.mat", "angular_rate": "b.mat"}},
            },
        }
    },
}


def ulog(log):
    def message(kind, body):
        return struct.pack("<HB", len(body), ord(kind)) + body

    layout = b"sensor_combined:uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;"
    content = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000)
    content += message("B", bytes(40)) + message("F", layout)
    content += message("I", b"\x0echar[3] sys_namPX4") + message("A", b"\0\1\0sensor_combined")
    for t, *axes in log[["t", *SIX[3:], *SIX[:3]]].to_numpy():
        content += message("D", struct.pack("<HQ6f", 1, int(t * 1e6) + 1000, *axes))
    return content


def matlab(log):
    variables = {"t": log.t.to_numpy(), "acc": log[SIX[:3]].to_numpy()}
    variables |= {"gyro": log[SIX[3:]].to_numpy(), "imu": {"note": "x", "temp": np.ones(ROWS)}}
    for packed in (False, True):
        file = io.BytesIO()
        savemat(file, variables, do_compression=packed)
        yield file.getvalue()
    file = io.BytesIO()
    with h5py.File(file, "w", userblock_size=512) as store:
        for name in ("t", "acc", "gyro"):
            data = store.create_dataset(name, data=np.atleast_2d(variables[name].T))
            data.attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file".ljust(124) + struct.pack("<H", 0x200) + b"IM"
    yield head + file.getvalue()[len(head) :]


def phyphox(log):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, kind, unit, axes in (
            ("Accelerometer.csv", "Acceleration", "m/s^2", SIX[:3]),
            ("Gyroscope.csv", "Gyroscope", "rad/s", SIX[3:]),
        ):
            header = ["Time (s)", *(f"{kind} {axis} ({unit})" for axis in "xyz")]
            archive.writestr(name, log[["t", *axes]].to_csv(index=False, header=header))
        archive.writestr("meta/device.csv", '"property","value"\n"deviceModel","A phone"\n')
    return file.getvalue()


def ros(folder, log, kind):
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    first = kind == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    types, name, path = store.types, "sensor_msgs/msg/Imu", folder / f"seed_{kind}"
    if first:
        writer = rosbag1.Writer(path)
    else:
        plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    vector, unknown = types["geometry_msgs/msg/Vector3"], np.zeros(9)
    turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    with writer:
        connection = writer.add_connection("/imu", name, typestore=store)
        for t, *axes in log[["t", *SIX]].to_numpy():
            stamp = 1_700_000_000 * 10**9 + int(t * 1e9)
            moment = types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
            more = {"seq": 0} if first else {}
            header = types["std_msgs/msg/Header"](stamp=moment, frame_id="imu", **more)
            message = types[name](
                header, turn, unknown, vector(*axes[3:]), unknown, vector(*axes[:3]), unknown
            )
            write = store.serialize_ros1 if first else store.serialize_cdr
            writer.write(connection, stamp, write(message, name))
    return (path if first else next(path.glob(f"*.{kind}"))).read_bytes()


NAMES = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"


def dataflash(log):
    def definition(number, size, name, codes, names):
        texts = (text.encode() for text in (name, codes, names))
        return struct.pack("<3BBB4s16s64s", 0xA3, 0x95, 0x80, number, size, *texts)

    content = definition(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    content += definition(144, 36, "IMU", "QBffffff", NAMES)
    for t, *axes in log[["t", *SIX[3:], *SIX[:3]]].to_numpy():
        content += struct.pack("<3BQB6f", 0xA3, 0x95, 144, int(t * 1e6), 0, *axes)
    return content


def dataflash_text(log):
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines.append(f"FMT, 144, 36, IMU, QBffffff, {NAMES}")
    for t, *axes in log[["t", *SIX[3:], *SIX[:3]]].to_numpy():
        lines.append(", ".join(["IMU", str(int(t * 1e6)), "0", *map(str, axes)]))
    return "\n".join(lines).encode()


def parquet(log):
    file = io.BytesIO()
    log.to_parquet(file, index=False)
    return file.getvalue()


def netcdf(folder, log):
    import netCDF4

    with netCDF4.Dataset(folder / "seed.nc", "w") as data:
        data.createDimension("time", ROWS)
        for name in log.columns:
            data.createVariable(name, "f8", ("time",))[:] = log[name].to_numpy()
    return (folder / "seed.nc").read_bytes()
