"""The pictures of a device by their kind: for the report, files and notebooks."""

from imuloop.report.figures.allan import allan_pictures, corrected_pictures, longest_curve_first
from imuloop.report.figures.attitude import attitude_pictures
from imuloop.report.figures.bias import bias_pictures, temperature_pictures
from imuloop.report.figures.loop import device_loop
from imuloop.report.figures.poses import pose_pictures
from imuloop.report.figures.residuals import residual_pictures
from imuloop.report.figures.spectrum import density_pictures
from imuloop.report.figures.time_series import session_pictures
from imuloop.report.findings import blocks

# functions that return the pictures of a device, of one of its sessions, of a diagnosis
OF_DEVICE = {"loop": device_loop, "poses": pose_pictures, "attitude": attitude_pictures}
OF_SESSION = {"series": session_pictures, "allan": allan_pictures, "spectra": density_pictures}
OF_RECORD = {
    "residuals": residual_pictures,
    "bias": bias_pictures,
    "temperature": temperature_pictures,
    "corrected": corrected_pictures,
}
KINDS = (*OF_DEVICE, *OF_SESSION, *OF_RECORD)


def pictures(device, kind):
    """Return the Pictures of one kind, such as ``allan``, a list.

    `device` is a DeviceResults, all results of one device, and `kind` is one of `KINDS`. The list
    is empty if the results have nothing to draw.
    """
    if kind in OF_DEVICE:
        return OF_DEVICE[kind](device)
    if kind in OF_SESSION:
        # the page shows the first
        used = longest_curve_first(device.used) if kind == "allan" else device.used
        return [p for session in used for p in OF_SESSION[kind](device, session)]
    return [p for block in blocks(device.diagnosis) for p in OF_RECORD[kind](device, block)]
