"""What every stage shares: units, samples, segments, rotation, model, effect, noise model."""
