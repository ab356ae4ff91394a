"""The two first pictures of a device's part: its main error, and its main recording."""

from dataclasses import replace

from imuloop.report.figures.bias import bias_pictures, temperature_pictures
from imuloop.report.figures.drawing import BESIDE
from imuloop.report.figures.residuals import residual_picture
from imuloop.report.figures.time_series import session_pictures
from imuloop.report.findings import blocks, residual_names, tested

# kinds of sessions, those with the most motion first
KINDS = ("multi_position", "six_position", "reference_motion", "known_rotation", "static")


def opening_pictures(device):
    """Return up to two Pictures that begin the part of a device: its main error and main recording.

    The main error is the one that the most telling verdict is about, and the main recording the
    session with the most motion. `device` is a DeviceResults.
    """
    pictures = []
    if diagnoses := tested(blocks(device.diagnosis)):
        # records with an effect or an error come first, then poses
        diagnoses.sort(key=lambda b: (not b["effects"], b["verdict"] == "consistent"))
        pictures += _wrong(device, diagnoses[0])
    if sessions := sorted(device.used, key=lambda s: KINDS.index(s.kind)):
        picture, _ = session_pictures(device, sessions[0])
        height = BESIDE[1] + 50 * (len(picture.rows) > 1)
        name = f"{device.name}.recorded"
        pictures.append(replace(picture, name=name, size=(BESIDE[0], height)))
    return pictures


def _wrong(device, block):
    """Return the Picture of the error that the verdict of a diagnosis is about, in a list.

    `device` is a DeviceResults, and `block` the diagnosis of a sensor in one kind of data, as
    `block_of` returns it.
    """
    if block["part"] == "static_record":
        pictures = temperature_pictures(device, block) or bias_pictures(device, block)
        return [replace(p, size=(BESIDE[0], p.size[1])) for p in pictures[:1]]
    name = block["quoted"] or residual_names(block)[0]
    return [residual_picture(device, block, name, narrow=True)]
