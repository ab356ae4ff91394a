"""Tables of each sensor, as phones write them: functions of a path, the log and options.

They return paths, or write the path.
"""

import zipfile

import numpy as np

from imuloop.core.units import STANDARD_GRAVITY
from ingest.logs import FORCE, RATE
from ingest.written import phyphox, sensor_logger, table


def zipped(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)


def apart(log):
    """Return tables of an accelerometer at 100 Hz and of a gyroscope that is 1.5 ms later."""
    force, rate = (log[["t", *c]].set_axis([*"txyz"], axis=1) for c in (FORCE, RATE))
    return force, rate.assign(t=log.t + 0.0015)


def pair(path, log, form):
    """Write a file of each sensor, and return their paths."""
    paths = [path.with_name(f"{name}.{form}") for name in "ab"]
    for path, sensor, unit in zip(paths, apart(log), ("m/s²", "rad/s"), strict=True):
        if form == "parquet":
            sensor.to_parquet(path)
        elif form == "txt":
            sensor.to_csv(path, header=False, sep=" ", index=False)
        else:
            # one file in s, with names that are declared; the other in ms
            ms = {"t": "t (ms)"} if unit == "rad/s" else {}
            sensor = sensor.assign(t=sensor.t * 1000 if ms else sensor.t, u=1.0, v=2.0, w=3.0)
            sensor.rename(columns=ms).to_csv(path, index=False)
    return paths


def tables_in_zip(path, log, count):
    tables = {"rec/imu.csv": log}
    if count == 2:
        tables = dict(zip(("rec/Accel.txt", "rec/gyro.txt"), apart(log), strict=True))
    form = {"header": count == 1, "sep": " ,"[count == 1], "index": False}
    members = {k: "# made by a logger\n" + table.to_csv(**form) for k, table in tables.items()}
    zipped(path, members | {"rec/notes.md": "at noon"})


# --- phones


def experiment(path, log, separator, decimal="."):
    zipped(path, phyphox(log, ("", ""), separator, decimal))


def in_one_table(path, log):
    header = ["Time (s)", *(f"Acceleration {a} (m/s^2)" for a in "xyz"), "Absolute (m/s^2)"]
    header += [f"Gyroscope {a} (rad/s)" for a in "xyz"]
    columns = [log.t, *(log[a] for a in FORCE), log.az, *(log[a] for a in RATE)]
    zipped(path, {"run/Raw Data.csv": table(header, columns), "__MACOSX/run/._a.csv": "\0"})


def with_linear(path, log, alone=False):
    linear = phyphox(log * 0.1, ("Linear Acceleration", ""))["Accelerometer.csv"]
    name = "Accelerometer.csv" if alone else "Linear Acceleration.csv"
    zipped(path, phyphox(log) | {name: linear})


def with_second(path, log):
    members = phyphox(log)
    zipped(path, members | {"Second.csv": members["Gyroscope.csv"]})


def one_log_twice(path, log):
    zipped(path, dict.fromkeys(("a.csv", "b.csv"), log.to_csv(index=False)))


def logger(path, log, about=("android", "false"), in_g=False, total=False):
    """Sensor Logger, with values that the phone has corrected, and uncalibrated ones or a total."""
    wrong = log.assign(bx=log.ax + 1, by=log.ay + 1, bz=log.az + 1, hx=0.5, hy=0.5, hz=0.5)
    if in_g:
        wrong[FORCE] = np.round(wrong[FORCE] / -STANDARD_GRAVITY, 6)
    usual = {"Accelerometer": ["hx", "hy", "hz"], "TotalAcceleration": FORCE, "Gyroscope": RATE}
    if not total:
        usual |= {"TotalAcceleration": ["bx", "by", "bz"], "Gyroscope": ["hx", "hy", "hz"]}
        usual |= {"AccelerometerUncalibrated": FORCE, "GyroscopeUncalibrated": RATE}
    zipped(path, sensor_logger(wrong, usual, about))
