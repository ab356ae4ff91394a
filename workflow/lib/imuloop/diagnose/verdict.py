"""The verdict on a residual, in the words of the contract."""

# what a diagnosis holds where nothing could be tested
NOTHING = {
    "residuals": {},
    "effects": [],
    "candidates": [],
    "confounded": [],
    "correlates": [],
}
# the figures of a candidate that could not be tried
UNTRIED = {
    "p_value": None,
    "heldout_after": None,
    "detection_limit": None,
    "confounded_with": None,
}


def verdict(above_before, above_after, effects):
    """Return the verdict in the contract's words."""
    if not effects:
        return "unexplained" if above_before else "consistent"
    return "partly_explained" if above_after else "explained"
