"""Figures of a device that are known before its logs are read, by data sheet and config."""

from dataclasses import asdict

from imuloop.core.errors import ImuloopError
from imuloop.sensors.data_sheets import GENERIC, PARTS, find_sensor


def device_figures(sensor=None, ranges=None, nominal=None, full_scale=None):
    """Return the scales, full scales, tolerances and noise densities of a device, a dict.

    Parameters
    ----------
    sensor : str, optional
        Name of the sensor, the part that the device has, in the table of data sheets.
    ranges, nominal, full_scale : dict, optional
        ``range``, ``nominal`` and ``full_scale`` of the config, by quantity: ``acceleration`` and
        ``angular_rate``. Their values replace those of the data sheet.

    Returns
    -------
    dict
        The dict has four keys, each with a dict. ``nominal`` has, for each quantity, the ``scale``,
        SI per count, and the ``offset``, counts. If the sensor has several ranges and none was
        chosen, the names of its ``ranges`` replace the scale. ``full_scale`` has the full scale of
        each quantity, SI. ``tolerances`` has the fields of a `Tolerance` for ``accelerometer`` and
        ``gyroscope``. ``data_sheet`` has the name of the ``sensor``, and in ``noise`` the typical
        density of white noise of ``accelerometer`` and ``gyroscope``, SI per √Hz; it is empty
        without a sensor. What is not known is left out.

    Raises
    ------
    ImuloopError
        If the table has no such sensor, or the sensor no such range.
    """
    if ranges and not sensor:
        raise ImuloopError("needs the device's sensor")
    sheet = find_sensor(sensor) if sensor else None
    scales, limits, tolerances, noise = {}, {}, {}, {}
    for quantity, part in PARTS.items():
        of_sheet, declared = getattr(sheet, part, None), dict((nominal or {}).get(quantity) or {})
        tolerance, range_name = declared.pop("tolerance", None), (ranges or {}).get(quantity)
        if range_name is not None or (of_sheet and len(of_sheet.ranges) == 1):
            chosen = sheet.choose_range(quantity, range_name)
            scale, density = {"scale": chosen.scale}, chosen.noise_density
            limits[quantity] = chosen.full_scale
        elif of_sheet:
            # without a choice the scale is not known, only the ranges to choose from
            scale, density = {"ranges": [r.name for r in of_sheet.ranges]}, of_sheet.noise_density
        else:
            scale, density = {}, None
        if scale | declared:
            scales[quantity] = scale | declared
        if density:
            noise[part] = density
        if of_sheet or tolerance:
            by_default = of_sheet.tolerance if of_sheet else GENERIC[part]
            tolerances[part] = asdict(by_default) | (tolerance or {})
    return {
        "nominal": scales,
        "full_scale": limits | (full_scale or {}),
        "tolerances": tolerances,
        "data_sheet": {"sensor": sheet.label, "noise": noise} if sheet else {},
    }
