"""Data sheets of common sensors: ranges, scales, noise densities and tolerances for a prior."""

from imuloop.sensors.data_sheets import (
    GENERIC,
    LARGEST,
    PARTS,
    Tolerance,
    find_sensor,
    listing,
    sensor_names,
)
from imuloop.sensors.device import device_figures

__all__ = [
    "GENERIC",
    "LARGEST",
    "PARTS",
    "Tolerance",
    "device_figures",
    "find_sensor",
    "listing",
    "sensor_names",
]
