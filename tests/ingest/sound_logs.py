"""Small sound logs of every format."""

import gzip
import io
import struct
import zipfile

import h5py
import netCDF4
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.io import savemat

from ingest import written

# a fifth more than a log needs: rows take time
ROWS = 120
SIX = "ax ay az gx gy gz".split()


def sound_logs(folder):
    """Return (file name, content) of each, made by way of a folder."""
    rng = np.random.default_rng(0)
    log = pd.DataFrame({"t": np.arange(ROWS) / 50})
    log[SIX] = rng.normal([0.1, -0.2, 9.8, 0, 0, 0.01], 0.01, size=(ROWS, 6)).round(5)
    text = log.to_csv(index=False).encode()
    rows = [(int(t * 1e6), 0, *axes) for t, *axes in log[["t", *SIX[3:], *SIX[:3]]].to_numpy()]
    dated = log.assign(t=pd.Timestamp("2024-01-01") + pd.to_timedelta(log.t, "s"), temp=20.5)
    return [
        ("log.csv", text),
        ("log.txt", log.to_csv(index=False, sep=" ", header=False).encode()),
        ("log.csv", log.to_csv(index=False, sep=";", decimal=",").encode()),
        ("log.tsv", b"# made by a logger\n" + dated.to_csv(index=False, sep="\t").encode()),
        ("log.csv", b"\xef\xbb\xbf" + text.replace(b"\n", b"\r\n")),
        ("log.csv.gz", gzip.compress(text, mtime=0)),
        *(("log.ulg", ulog(log, topics)) for topics in TOPICS),
        *(("log.mat", each) for each in matlab(log)),
        ("log.zip", zipped(written.phyphox(log))),
        ("log.zip", zipped(written.sensor_logger(log, PHONE), zipfile.ZIP_DEFLATED)),
        *ros(folder, log),
        *(("log.bin", kind(("IMU", IMU, rows))) for kind in (written.binary, written.text)),
        *(("log.parquet", each) for each in parquet(log)),
        ("log.feather", feather(log)),
        *((f"log.{end}", each) for end, each in numpys(log)),
        ("log.jsonl", log.to_json(orient="records", lines=True).encode()),
        ("log.gcsv", b"GYROFLOW IMU LOG\ntscale,0.0018\ngscale,1\nascale,0.1\n" + text),
        *(("log.nc", each) for each in netcdf(folder, log)),
    ]


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


# what is left without gravity is called Accelerometer
PHONE = {"Accelerometer": SIX[3:], "TotalAcceleration": SIX[:3], "GyroscopeUncalibrated": SIX[3:]}


def zipped(members, packing=zipfile.ZIP_STORED):
    """Return a zip of texts by name, whose dates are always the same."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", packing) as archive:
        for name, text in members.items():
            archive.writestr(zipfile.ZipInfo(name), text, packing)
    return file.getvalue()


# axes of the gyroscope first
IMU = "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
BAGS = ("bag", "bag BZ2", "bag LZ4", "mcap", "mcap STORAGE", "db3")


def ros(folder, log):
    stamps = written.START + (log.t * 1e9).astype("int64")
    for kind in BAGS:
        topics = {"/imu": (written.IMU, stamps, log[SIX].to_numpy())}
        path, kind = written.bag(folder, kind, topics, name=kind), kind.partition(" ")[0]
        yield f"log.{kind}", (path if path.is_file() else next(path.glob(f"*.{kind}"))).read_bytes()


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


def feather(log):
    file = io.BytesIO()
    log.to_feather(file)
    return file.getvalue()


def numpys(log):
    arrays = {
        "t": log.t.to_numpy(),
        "acc": log[SIX[:3]].to_numpy(),
        "gyro": log[SIX[3:]].to_numpy(),
    }
    for end, save in (
        ("npy", lambda file: np.save(file, log.to_numpy())),
        ("npy", lambda file: np.save(file, log.to_records(index=False))),
        ("npz", lambda file: np.savez_compressed(file, **arrays)),
    ):
        file = io.BytesIO()
        save(file)
        yield end, file.getvalue()


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
