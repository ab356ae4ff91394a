"""The calibration and the noise in other tools' formats."""
