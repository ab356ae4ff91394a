"""Validation of a calibration: error of the attitude in held-out data, and drift in a new log."""
