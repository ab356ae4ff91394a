"""From a calibration to the next recording: what it would improve, before it is made."""
