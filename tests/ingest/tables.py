"""Text tables of known samples, and whether they came back."""

import numpy as np

ACCELERATION, RATE = ["ax", "ay", "az"], ["gx", "gy", "gz"]


def table(header, columns, write="{}".format, separator=",", decimal="."):
    lines = [separator.join(header)]
    for row in zip(*columns, strict=True):
        lines.append(separator.join(write(x).replace(".", decimal) for x in row))
    return "\n".join(lines) + "\n"


def same(samples, log):
    for name in log.columns:
        np.testing.assert_array_equal(samples[name], log[name])
    return True


def check(done, log, scale=1, t=None):
    expected = log.assign(**{name: scale * log[name] for name in ACCELERATION})
    assert same(done.samples, expected if t is None else expected.assign(t=t))
