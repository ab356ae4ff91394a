"""Data sheets of common sensors: ranges, scales, noise densities and tolerances."""

from imuloop.sensors.data_sheets import (
    GENERIC as GENERIC,
)
from imuloop.sensors.data_sheets import (
    LARGEST as LARGEST,
)
from imuloop.sensors.data_sheets import (
    PARTS as PARTS,
)
from imuloop.sensors.data_sheets import (
    Tolerance as Tolerance,
)
from imuloop.sensors.data_sheets import (
    find_sensor as find_sensor,
)
from imuloop.sensors.data_sheets import (
    sensor_names as sensor_names,
)
from imuloop.sensors.device import device_figures as device_figures
