"""Files that are not logs, or that hold less than they say: functions of a path and a sound log."""

import sqlite3
import zipfile

import h5py
import netCDF4
import numpy as np

from imuloop.core.samples import CHANNELS
from ingest.array_forms import netcdf
from ingest.logs import brief


def sqlite(path, log):
    database = sqlite3.connect(path)
    log.to_sql("samples", database)
    database.close()


def archive(path, _, members):
    with zipfile.ZipFile(path, "w") as file:
        for name in members:
            file.writestr(name, "<xml/>")


def pickled(path, _):
    np.save(path, {"a": 1})


def damaged_too(path, log):
    np.savez(path, **log)
    with zipfile.ZipFile(path, "a") as file:
        file.writestr("temperature.npy", b"\x93NUMPY")


def broken_variable(path, log):
    netcdf(path, log)
    content = bytearray(path.read_bytes())
    content[content.rindex(b"OHDR") + 6] ^= 255
    path.write_bytes(content)


def zeros_in_zip(path, _):
    np.savez_compressed(path, t=np.zeros(10**7))


def bomb(path, _):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("log.csv", "0.1,1,2,3,4,5,6\n" * (1 << 16))


def announced(path, _):
    """An array of 8 TB, of which nothing is in the file."""
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({1 << 40}, 7), }}".ljust(117)
    content = b"\x93NUMPY\1\0v\0" + header.encode() + b"\n"
    if path.suffix == ".npz":
        with zipfile.ZipFile(path, "w") as file:
            file.writestr("t.npy", content)
    else:
        path.write_bytes(content)


def never_written(path, _):
    """An array of 24 TB, none of which is in the file."""
    with h5py.File(path, "w") as file:
        file.create_dataset("acc", (3, 1 << 40), "f8", chunks=(3, 1 << 10))


def nested(path, _):
    """Groups in each other, over which libraries are slow."""
    with h5py.File(path, "w") as file:
        group = file
        for _ in range(3000):
            group = group.create_group("g")


def rows_announced(path, _):
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("time", 1 << 40)
        for name in CHANNELS:
            data.createVariable(name, "f8", ("time",), chunksizes=(1000,))


def cut_off(path, log, of):
    rows_announced(path, log) if of == "rows_announced" else brief(20_000).to_parquet(path)
    path.write_bytes(path.read_bytes()[:5000])


def spoilt(path, _):
    brief(20_000).to_parquet(path, index=False, compression="gzip")
    content = path.read_bytes()
    half = len(content) // 2
    path.write_bytes(content[:half] + bytes(400) + content[half + 400 :])
