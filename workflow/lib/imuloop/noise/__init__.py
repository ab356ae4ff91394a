"""From rests to noise coefficients: Allan deviation, fit, statistics."""

from imuloop.core.deferred import defer

defer()
