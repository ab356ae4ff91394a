"""Modules that all stages use: errors, files, units, samples, segments, rotations, noise model."""
