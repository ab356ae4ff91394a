"""Factors of the joint fit: each kind of measurement has a residual, a Jacobian and a noise."""
