"""One estimator: evidence, test, search, held-out errors, detection limits and verdict."""
