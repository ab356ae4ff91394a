"""From a calibration to what it needs: what limits it, and what would improve that most."""
