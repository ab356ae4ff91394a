"""Factors of the joint fit: each kind of measurement has a residual, a Jacobian and a noise.

A rest is a pose of the device. A move is what lies between two rests; the device rotates in it.
Nominal SI values are raw readings minus the offset, times the scale of the data sheet.
"""
