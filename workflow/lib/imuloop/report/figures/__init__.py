"""Figures of the report, each drawn by a function of its axes and a result."""
