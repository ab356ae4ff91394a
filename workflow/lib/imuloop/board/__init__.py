"""Devices on one board: how their frames lie to each other, and whether they agree."""
