"""Kinds of measurement: residual, derivative and noise of each."""
