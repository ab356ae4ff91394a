"""Devices of one type together: what they share, how they spread, which stand out."""
