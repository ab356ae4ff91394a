"""Validation of a calibration: held-out attitude, and drift in a new log."""
