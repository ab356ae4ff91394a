"""From rests to noise coefficients: Allan deviation, fit, statistics."""
