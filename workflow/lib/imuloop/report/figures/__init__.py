"""Figures of the report: functions that take results of a device and return pictures."""
