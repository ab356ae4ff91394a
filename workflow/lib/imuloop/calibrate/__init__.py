"""From poses and rotations to a calibration: six-position and multi-position."""
