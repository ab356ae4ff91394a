"""The next step of a session: the rest or turn that improves the calibration most."""
