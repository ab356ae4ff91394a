"""From a calibration to what a user feels of it: held-out attitude, and drift in a new log."""
