"""Data sheets of common sensors: ranges, scales, noise densities and tolerances for a prior."""

from imuloop.sensors.data_sheets import GENERIC, Tolerance, find_sensor, listing, sensor_names

__all__ = ["GENERIC", "Tolerance", "find_sensor", "listing", "sensor_names"]
