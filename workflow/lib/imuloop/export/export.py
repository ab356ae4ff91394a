"""The folder of a device's exports: a file per tool, and README.txt that says what is in them."""

import hashlib
import shutil
from pathlib import Path

# a calibration may hold any effect of the library
import imuloop.effects  # noqa: F401
from imuloop.core.errors import Lacking, one_line
from imuloop.core.files import read_json, write_json
from imuloop.core.model import Calibration
from imuloop.core.noise_model import NoiseModel
from imuloop.export.autopilots import ARDUPILOT, PX4
from imuloop.export.c_header import C_HEADER
from imuloop.export.exported import MODEL, Exported
from imuloop.export.filters import ALLAN_VARIANCE_ROS, KALIBR, ORB_SLAM3, ROS, VINS_FUSION
from imuloop.export.gnss_ins_sim import GNSS_INS_SIM
from imuloop.export.imu_tk import ACCELEROMETER, GYROSCOPE
from imuloop.export.matlab_imu_sensor import MATLAB_IMU_SENSOR, MATLAB_PARAMETERS
from imuloop.export.openvins import OPENVINS

FORMATS = (
    *(KALIBR, OPENVINS, VINS_FUSION, ORB_SLAM3, ALLAN_VARIANCE_ROS, ROS),
    *(ACCELEROMETER, GYROSCOPE, PX4, ARDUPILOT, MATLAB_IMU_SENSOR, MATLAB_PARAMETERS),
    *(GNSS_INS_SIM, C_HEADER),
)
README = "README.txt"


def read_exported(device, label, calibration, noise, quality, diagnosis=None):
    """Return a device as the formats take it, from its JSON files.

    The quality of its sessions gives the temperatures, and the rate where the noise has none; the
    diagnosis what a reference shows of clock and place.
    """
    sensors = read_json(diagnosis)["sensors"] if diagnosis else {}
    content = read_json(noise)
    used = [found for path in quality if (found := read_json(path))["status"] == "ok"]
    # a reference whose clock began apart has no offset that holds in the next recording
    own_clock = any(found.get("reference", {}).get("clock", {}).get("own") for found in used)
    beside = {
        (sensor, effect["name"]): effect["parameters"]
        for sensor, parts in sensors.items()
        for effect in parts.get("reference", {}).get("effects", ())
        if not (own_clock and effect["name"] == "time_offset")
    }
    longest = max(used, key=lambda found: found["rows"], default={})
    spans = [span for found in used if (span := found["temperature_range"])]
    return Exported(
        device,
        label,
        Calibration.from_json(calibration),
        NoiseModel.from_dict(content),
        content["rate_hz"] or longest.get("rate_hz"),
        tuple(content["notes"]),
        (min(map(min, spans)), max(map(max, spans))) if spans else None,
        beside,
    )


def export_files(exported):
    """Return the text of each file by its name; README.txt says which are not there and why."""
    files, carried, left_out = {}, [], []
    for each in FORMATS:
        try:
            files[each.file] = each.text(exported)
            carried.append(f"{each.file}: {each.title}")
        except Lacking as reason:
            left_out.append(f"{each.file} ({each.title}): {reason}")
    lines = [
        f"Calibration and noise of {exported.label} ({exported.device}) for other tools.",
        f"All of it, with covariances: ../calibration.json and ../noise.json; {MODEL}.",
        "What each field holds, and what a format cannot carry, stands in its file.",
        "",
        "Files:",
        *(carried or ["none"]),
    ]
    for title, more in (
        ("Not written:", left_out),
        ("Not fully calibrated:", exported.calibration.limits()),
        ("On the noise:", exported.notes),
    ):
        lines += ["", title, *more] if more else []
    files[README] = "".join(f"{one_line(line)}\n" for line in lines)
    return files


def write_exports(folder, files, failed=None):
    """Write the files into `folder`, in the place of what it held before, and a list of them.

    The list, ``exports.json`` beside the folder, holds the SHA-256 of each file by its name, and
    what `failed` where there is nothing to write.
    """
    folder = Path(folder)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    hashes = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in files.items()}
    write_json(
        folder.with_suffix(".json"), {"sha256": hashes} | ({"failed": failed} if failed else {})
    )


def listed(path):
    """Return the file name and the tool of each export in a device's list of them."""
    names = read_json(path)["sha256"]
    return [(each.file, each.title) for each in FORMATS if each.file in names]
