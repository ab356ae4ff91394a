"""What every stage shares: errors, files, units, samples, segments, rotations, noise model."""
