"""A sensor beside a reference: its recording, and models of its rotations and its force."""
