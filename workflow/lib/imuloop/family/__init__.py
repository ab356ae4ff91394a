"""Devices of one type together: what they share, how they spread, which stand out."""

# devices that are compared
LEAST = 3
# other devices that a prior needs: the variance of Student's t with fewer is not finite
LEAST_OTHERS = 4
