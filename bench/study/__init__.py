"""Simulated study of the diagnosis: undeclared effects, controls, and what lies outside."""
