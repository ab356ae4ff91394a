"""Simulated study of the diagnosis: undeclared effects, and controls."""
