"""The parameters of a device and the equation of its sensors."""
