"""The pictures of a device by their kind: what the report, files and notebooks show."""

from imuloop.report.figures.allan import allan_pictures, corrected_pictures, longest_curve_first
from imuloop.report.figures.attitude import attitude_part
from imuloop.report.figures.bias import bias_pictures
from imuloop.report.figures.loop import device_loop
from imuloop.report.figures.poses import pose_picture
from imuloop.report.figures.residuals import residual_pictures
from imuloop.report.figures.spectrum import density_pictures
from imuloop.report.figures.time_series import session_pictures
from imuloop.report.verdict import blocks


def _residuals(device, sensor, part, block):
    return [] if part == "static_record" else residual_pictures(device, sensor, block)


def _corrected(device, sensor, part, block):
    known = part == "static_record" and block["effects"]
    return corrected_pictures(device, sensor) if known else []


def _only(picture):
    return [picture] if picture else []


# what is drawn of a device, by kind; of each of its sessions; of each record of a sensor
OF_DEVICE = {
    "loop": lambda device: _only(device_loop(device)),
    "poses": lambda device: _only(pose_picture(device)),
    "attitude": lambda device: attitude_part(device)["pictures"],
}
OF_SESSION = {
    "series": session_pictures,
    "allan": allan_pictures,
    "spectra": density_pictures,
}
OF_RECORD = {
    "residuals": _residuals,
    "bias": lambda device, sensor, _, block: bias_pictures(device, sensor, block),
    "corrected": _corrected,
}
KINDS = (*OF_DEVICE, *OF_SESSION, *OF_RECORD)


def pictures(device, kind):
    """Return the `Picture` objects of one of `KINDS`, of a device that the report has read."""
    if kind in OF_DEVICE:
        return OF_DEVICE[kind](device)
    if kind in OF_SESSION:
        # the page shows the first
        used = longest_curve_first(device.used) if kind == "allan" else device.used
        return [p for session in used for p in OF_SESSION[kind](device, session)]
    return [p for each in blocks(device.diagnosis) for p in OF_RECORD[kind](device, *each)]
