"""Figures of a device that are known before its logs are read: by data sheet and declaration."""

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
        ``range``, ``nominal`` and ``full_scale`` of the config, by quantity: ``acceleration`` and
        ``angular_rate``. Their values replace those of the data sheet.

    Returns
    -------
    dict
        ``nominal``: by quantity, the ``scale`` and ``offset`` of counts, SI; if a range has to be
        chosen and is not, the names of all ``ranges`` instead of the scale of the data sheet.
        ``full_scale``: by quantity, SI. ``tolerances``: the fields of a `Tolerance`, by
        ``accelerometer`` and ``gyroscope``. ``data_sheet``: the name of the ``sensor``, and its
        typical ``noise``, SI per √Hz, by ``accelerometer`` and ``gyroscope``; empty without a name.

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
        # what the config states on the quantity, and the range that the config chooses
        stated, wanted = dict((nominal or {}).get(quantity) or {}), (ranges or {}).get(quantity)
        tolerance = stated.pop("tolerance", None) or {}
        figures, by_default = getattr(sheet, part, None), GENERIC[part]
        if wanted is not None or (figures and len(figures.ranges) == 1):
            chosen = sheet.choose_range(quantity, wanted)
            stated = {"scale": chosen.scale} | stated
            limits[quantity], density = chosen.full_scale, chosen.noise_density
        elif figures:
            # without a choice the scale is not known, only the ranges to choose from
            stated = {"ranges": [one_range.name for one_range in figures.ranges]} | stated
            density = figures.noise_density
        if figures:
            by_default = figures.tolerance
            noise |= {part: density} if density else {}
        if stated:
            scales[quantity] = stated
        if figures or tolerance:
            tolerances[part] = asdict(by_default) | tolerance
    return {
        "nominal": scales,
        "full_scale": limits | (full_scale or {}),
        "tolerances": tolerances,
        "data_sheet": {"sensor": sheet.label, "noise": noise} if sheet else {},
    }
