"""Figures of a device that are known before its logs, by data sheet and declaration."""

from dataclasses import asdict

from imuloop.core.errors import ImuloopError
from imuloop.sensors.data_sheets import GENERIC, PARTS, find_sensor


def device_figures(sensor=None, ranges=None, nominal=None, full_scale=None):
    """Return the scales, full scales, tolerances and noise densities of a device.

    Parameters
    ----------
    sensor : str, optional
        Name of the sensor in the table.
    ranges, nominal, full_scale : dict, optional
        By quantity, ``range``, ``nominal`` and ``full_scale`` as in the config. What they state
        goes before the data sheet.

    Returns
    -------
    dict
        ``nominal`` and ``full_scale`` by quantity, SI; of a sensor without the range that it needs
        ``nominal`` holds the ``ranges`` to choose from. ``tolerances`` by sensor, the fields of a
        `Tolerance`. ``data_sheet``, empty without a name: the ``sensor`` and its typical ``noise``,
        SI per √Hz, by sensor.

    Raises
    ------
    ImuloopError
        If the table has no such sensor, or the sensor no such range.
    """
    if ranges and not sensor:
        raise ImuloopError("range: needs the name of the sensor")
    sheet = find_sensor(sensor) if sensor else None
    scales, limits, tolerances, noise = {}, {}, {}, {}
    for quantity, part in PARTS.items():
        # statements of the config on the quantity, and the range that it chooses
        stated, wanted = dict((nominal or {}).get(quantity) or {}), (ranges or {}).get(quantity)
        tolerance = stated.pop("tolerance", None) or {}
        figures, usual = getattr(sheet, part, None), GENERIC[part]
        if wanted is not None or (figures and len(figures.ranges) == 1):
            chosen = sheet.choose_range(quantity, wanted)
            stated = {"scale": chosen.scale} | stated
            limits[quantity], density = chosen.full_scale, chosen.noise_density
        elif figures:
            # without a choice the scale is not known, only the ranges to choose from
            stated = {"ranges": [one_range.name for one_range in figures.ranges]} | stated
            density = figures.noise_density
        if figures:
            usual = figures.tolerance
            noise |= {part: density} if density else {}
        if stated:
            scales[quantity] = stated
        if figures or tolerance:
            tolerances[part] = asdict(usual) | tolerance
    return {
        "nominal": scales,
        "full_scale": limits | (full_scale or {}),
        "tolerances": tolerances,
        "data_sheet": {"sensor": sheet.label, "noise": noise} if sheet else {},
    }
