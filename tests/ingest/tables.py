"""Text tables of known samples, and whether they came back."""

import numpy as np

ACCELERATION, RATE = ["ax", "ay", "az"], ["gx", "gy", "gz"]


def table(header, columns, write="{}".format, separator=",", decimal="."):
    """Return the text of a CSV table."""
    lines = [separator.join(header)]
    for row in zip(*columns, strict=True):
        lines.append(separator.join(write(x).replace(".", decimal) for x in row))
    return "\n".join(lines) + "\n"


def check(done, log, scale=1, t=None):
    """Assert that the samples are those of the log, its acceleration scaled."""
    np.testing.assert_array_equal(done.samples.t, log.t if t is None else t)
    for name in ACCELERATION:
        np.testing.assert_array_equal(done.samples[name], scale * log[name])
    for name in RATE:
        np.testing.assert_array_equal(done.samples[name], log[name])
