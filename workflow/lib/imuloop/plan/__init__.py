"""The parameter that limits a calibration, and the rest or turn that improves it most."""
