"""What every stage shares: units, samples, segments, rotation, model, effect, noise model."""

from imuloop.core.deferred import defer

defer()
