"""Simulation: from the known truth of a device to a raw log."""
