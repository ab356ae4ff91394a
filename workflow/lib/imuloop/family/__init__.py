"""Comparison of the devices of one type: their mean, their spread, and odd devices."""

# fewest devices that are compared
LEAST = 3
# fewest other devices for a prior: with fewer the variance of Student's t is not finite
LEAST_OTHERS = 4
