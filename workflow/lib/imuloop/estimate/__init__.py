"""One estimator: fit with a prior, size of the noise, test, held-out errors, limits, verdict."""
