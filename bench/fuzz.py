"""Mutated logs and configs: does any of them crash, hang, or write outside of its folder?

From the repository, its library on the path: ``python -m bench.fuzz --cases 20000``. Each case is
made of its number alone; ``--first N --cases 1`` makes one again and ``--keep FOLDER`` its file.
A worker reads it within 10 s and 2 GB; good ends are a session, a rejected one, or one line on
what is declared wrongly.
"""

import argparse
import gzip
import io
import json
import multiprocessing
import os
import random
import re
import resource
import shutil
import struct
import sys
import tempfile
import time
import traceback
import warnings
import zipfile
from collections import Counter
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import yaml
from scipy.io import savemat

from imuloop.config import resolve
from imuloop.config_faults import config_faults, unreadable
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json
from imuloop.core.samples import read_samples
from imuloop.ingest.ingest import ingest

REPOSITORY = Path(__file__).resolve().parents[1]
SECONDS, MEMORY = 10, 2 << 30
ROWS = 150
SIX = "ax ay az gx gy gz".split()
# what breaks numbers, texts, tables and paths
TOKENS = "nan inf -inf 1e999 -0 0x10 1_000 9223372036854775808 1e-320 é \ufeff , ; ,,,, # ' \\ {{"
TOKENS += " 2024-13-45T99:00 2024-01-01T00:00:00Z ../../x /etc/passwd <script> %PDF t ax ax.x"
TOKENS = [*TOKENS.split(), "", " ", "\t", "\r", "\n", "\0", '"']
VALUES = [None, True, -1, 0, 1e308, float("nan"), float("inf"), 2**70, "", "x" * 300, "../x", "/"]
VALUES += ["/dev/zero", "<b>", "\x1b[2J", "no", [], {}, [1], [[]], {"a": {}}, {1: 2}, "gone.csv"]
VALUES += ["log.csv", "count", ["ax", "ay"], ["ax", "ay", "az"], [5, "a"], "2024-01-01", 0.1]
# events of Python that no log may cause
FORBIDDEN = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "socket.")
FORBIDDEN += ("pickle.", "shutil.", "ctypes.dlopen", "webbrowser.", "ftplib.", "urllib.")
CHANGES = ("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.chmod")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--only", help="one of the kinds of logs")
    parser.add_argument("--keep", type=Path, help="folder for the files of faulty cases")
    options = parser.parse_args()
    start = time.monotonic()
    ends, faults = fuzz(**vars(options))
    for kind in sorted({kind for kind, _ in ends}):
        listed = ", ".join(f"{n} {end}" for (k, end), n in sorted(ends.items()) if k == kind)
        print(f"{kind:<12} {listed}")
    print(f"{ends.total()} cases in {time.monotonic() - start:.0f} s, {len(faults)} faulty")
    for number, kind, text in faults:
        print(f"case {number}, {kind}: {text}")
    return bool(faults)


def fuzz(cases, seconds=float("inf"), first=0, only=None, keep=None):
    """Run cases in a worker; return how they ended, and the faulty ones.

    Parameters
    ----------
    cases, first : int
        How many, from which number on.
    seconds : float
        No case begins after so long.
    only : str, optional
        Kind of log; all if None.
    keep : Path, optional
        Folder for the files of faulty cases.

    Returns
    -------
    ends : Counter
        (kind, end) to number of cases.
    faults : list of (int, str, str)
        Number, kind and what happened.
    """
    ends, faults, worker = Counter(), [], None
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        seeds = all_seeds(Path(folder))
        four = b"0 0 0 9.8\n" * ROWS
        beside = {"log.csv": seeds["csv"][0][1], "a.mat": four, "b.mat": four}
        seeds = {kind: each for kind, each in seeds.items() if only in (None, kind)}
        begin = time.monotonic()
        for number in range(first, first + cases):
            if time.monotonic() - begin > seconds:
                break
            work = Path(folder) / "work"
            shutil.rmtree(work, ignore_errors=True)
            work.mkdir()
            worker = worker or Worker(work)
            kind, name, content, declared = case(number, seeds)
            for other, text in beside.items() if kind == "config" else ():
                (work / other).write_bytes(text)
            (work / name).write_bytes(content)
            end, fault = worker.run(name, declared)
            ends[kind, end] += 1
            if fault:
                faults.append((number, kind, fault))
                if keep:
                    keep.mkdir(parents=True, exist_ok=True)
                    (keep / f"{number}_{name}").write_bytes(content)
            if not worker.lives():
                worker = None
        if worker:
            worker.stop()
    return ends, faults


class Worker:
    """A process that reads cases in a folder."""

    def __init__(self, folder):
        context = multiprocessing.get_context("fork")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=serve, args=(other, folder), daemon=True)
        self.process.start()
        other.close()

    def run(self, name, declared):
        """Return how a case ended, and its fault or None."""
        self.pipe.send((name, declared))
        if not self.pipe.poll(SECONDS):
            self.stop()
            return "hang", f"not done within {SECONDS} s"
        try:
            return self.pipe.recv()
        except EOFError:
            self.process.join()
            return "crash", f"the process ended with {self.process.exitcode}"

    def lives(self):
        return self.process.is_alive()

    def stop(self):
        self.process.kill()
        self.process.join()


def serve(pipe, folder):
    """Answer cases, within a limit of memory; tell what is written or run elsewhere."""
    sys.dont_write_bytecode = True
    # numbers near the largest overflow; what counts is the results
    warnings.simplefilter("ignore")
    quiet = os.open(os.devnull, os.O_WRONLY)
    # libraries print on broken files
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    tempfile.tempdir = str(folder)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    inside, outside = f"{folder}{os.sep}", []

    def watch(event, arguments):
        if event == "open":
            path, _, flags = arguments
            if not isinstance(path, (str, bytes)) or not flags & (os.O_WRONLY | os.O_RDWR):
                return
        elif event in CHANGES:
            path = arguments[0]
        elif event.startswith(FORBIDDEN):
            outside.append(f"{event} {arguments}"[:300])
            return
        else:
            return
        path = os.path.abspath(os.fsdecode(path))
        if not f"{path}{os.sep}".startswith(inside) and path != os.devnull:
            outside.append(f"{event} {path}")

    sys.addaudithook(watch)
    while True:
        name, declared = pipe.recv()
        # the folder is made anew for each case
        os.chdir(folder)
        outside.clear()
        try:
            end, fault = judge_config(name) if name == "config.yaml" else judge_log(name, declared)
        except MemoryError:
            end, fault = "memory", f"more than {MEMORY >> 30} GB"
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            where = [f"{Path(f.filename).name}:{f.lineno}" for f in frames]
            end, fault = "traceback", f"{type(error).__name__} {error} ({' '.join(where[-4:])})"
        left = {p.as_posix() for p in Path().rglob("*") if p.is_file()}
        left -= {name, "log.csv", "a.mat", "b.mat", "out/samples.parquet", "out/quality.json"}
        fault = fault or (outside and outside[0]) or (left and f"left behind {sorted(left)}")
        pipe.send((end, fault or None))


def judge_log(name, declared):
    """Return how a log was read, and what is wrong with its results."""
    try:
        ingest(
            device="imu",
            session="a",
            kind="static",
            paths=[name],
            samples_path="out/samples.parquet",
            quality_path="out/quality.json",
            **declared,
        )
    except ImuloopError as error:
        return "declared", None if str(error) else "no words"
    quality, samples = read_json("out/quality.json"), read_samples("out/samples.parquet")
    t = samples.t.to_numpy()
    if quality["status"] == "rejected":
        sound = not len(t) and quality["reasons"]
    else:
        sound = t[0] == 0 and (np.diff(t) > 0).all() and np.isfinite(samples[SIX]).all(axis=None)
    return quality["status"], None if sound else "the results are not sound"


def judge_config(name):
    """Return whether a config has faults, and what is wrong with their lines."""
    if unreadable(name):
        return "unreadable", None
    config = yaml.safe_load(Path(name).read_text(encoding="utf-8"))
    schema = REPOSITORY / "workflow/schemas/config.schema.yaml"
    found = config_faults(config, {name: name}, schema, {"iphone_6": ["static"]})
    if not found:
        resolve(config)
    return ("faults" if found else "ok"), next((x for x in found if not x.isprintable()), None)


def case(number, seeds):
    """Return kind, file name, content and declarations of a case."""
    rng = random.Random(number)
    kind = rng.choice(sorted(seeds))
    name, content = rng.choice(seeds[kind])
    if kind == "config":
        return kind, name, config_case(rng, content), {}
    if kind == "zip" and rng.random() < 0.6:
        content = zip_case(rng, content)
    else:
        content = mutate(rng, content, kind == "csv", seeds[kind])
    if kind == "csv" and name.endswith(".gz"):
        content = gzip.compress(content, 1)
    declared = {}
    if rng.random() < 0.2:
        quantity = rng.choice(["time", "acceleration", "angular_rate", "temperature"])
        columns = [0, "t", "ax", ["ax", "ay", "az"], [1, 2, 3], "imu", ["/imu.x"] * 3, "IMU_0"]
        declared["columns"] = {quantity: rng.choice(columns)}
    if rng.random() < 0.2:
        declared["units"] = {"time": rng.choice(["s", "us", "ns", "ISO 8601"])}
    if rng.random() < 0.1:
        declared["rate"] = rng.choice([100, 1e-9, 1e12])
    if rng.random() < 0.1:
        declared["time_range"] = rng.choice([(0, 0.2), (None, "2024-01-01"), (0.1, None)])
    return kind, name, content, declared


def mutate(rng, content, text, seeds):
    """Return bytes with a few changes."""
    data = bytearray(content)
    for _ in range(rng.choice([1, 1, 1, 2, 3, 5, 20])):
        at, size = rng.randrange(len(data) + 1), int(2 ** rng.uniform(0, 9))
        way = rng.randrange(9 if text else 7)
        if way == 0:
            data[at : at + size] = rng.randbytes(size)
        elif way == 1:
            del data[at : at + size]
        elif way == 2:
            begin = rng.randrange(len(data) + 1)
            data[at:at] = data[begin : begin + size] * rng.choice([1, 1, 2, 300])
        elif way == 3 and data:
            data[at % len(data)] ^= 1 << rng.randrange(8)
        elif way == 4:
            number = rng.choice([0, 1, -1, 127, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**62])
            width = rng.choice([1, 2, 4, 8])
            order = rng.choice(["little", "big"])
            data[at : at + width] = (number % 256**width).to_bytes(width, order)
        elif way == 5:
            del data[rng.randrange(len(data) + 1) :]
        elif way == 6:
            _, other = rng.choice(seeds)
            data[at:] = other[rng.randrange(len(other)) :]
        elif way == 7:
            data[at : at + rng.randrange(4)] = rng.choice(TOKENS).encode("utf-8")
        else:
            lines = bytes(data).split(b"\n")
            token = rng.choice(TOKENS).encode("utf-8")
            row = rng.randrange(len(lines))
            fields = re.split(rb"([,;\t ])", lines[row])
            fields[2 * rng.randrange(len(fields) // 2 + 1)] = token
            lines[row] = b"".join(fields)
            if rng.random() < 0.3:
                rng.shuffle(lines)
            data = bytearray(b"\n".join(lines))
    return bytes(data)


def zip_case(rng, content):
    """Return a sound zip whose members, or their names, are mutated."""
    written = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(written, "w") as new:
        for name in old.namelist():
            text = old.read(name)
            way = rng.randrange(4)
            if way == 0:
                name = rng.choice(["../", "/", "a/", "C:\\", "..\\", "\x00", "é"]) + name
            elif way == 1:
                text = mutate(rng, text, True, [(name, text)]) or b"x"
            elif way == 2 and rng.random() < 0.2:
                text = text[:200] + bytes(1 << 22)
            packing = rng.choice([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
            new.writestr(zipfile.ZipInfo(name), text, packing)
    return written.getvalue()


def config_case(rng, content):
    """Return a config with a few changed values, or with changed bytes."""
    if rng.random() < 0.3:
        return mutate(rng, content, True, [("", content)])
    config = yaml.safe_load(content)
    for _ in range(rng.choice([1, 1, 2, 4])):
        node = config
        while True:
            keys = list(node) if isinstance(node, dict) else list(range(len(node)))
            if not keys:
                break
            key = rng.choice(keys)
            if isinstance(node[key], (dict, list)) and rng.random() < 0.8:
                node = node[key]
                continue
            if rng.random() < 0.2 and isinstance(node, dict):
                node[rng.choice(["", "../x", "é", "exports", 7, None, "a" * 99])] = node.pop(key)
            else:
                node[key] = rng.choice(VALUES)
            break
    return yaml.safe_dump(config, allow_unicode=True).encode()


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


if __name__ == "__main__":
    sys.exit(main())
