"""The record that all contenders read: six axes at rest, white noise and a random walk."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from bench.peers.calls import RATE, averaging_factors
from bench.stages import jobs, run
from imuloop.core.samples import CHANNELS, TIME, schema

# SI, of accelerometer and gyroscope; the walk shows from a minute on
N, K = (1e-3, 1e-4), (2e-5, 2e-6)
MEAN = (0.1, -0.2, 9.8, 0.01, -0.02, 0.03)
ROW_GROUP = 1 << 17


def write(folder, n):
    """Write `n` samples for the peers and, segmented, for the noise stage; return its job."""
    rng = np.random.default_rng(1)
    axes = np.empty((6, n))
    for i, x in enumerate(axes):
        x[:] = rng.standard_normal(n)
        x *= K[i // 3] / np.sqrt(RATE)
        np.cumsum(x, out=x)
        x += N[i // 3] * np.sqrt(RATE) * rng.standard_normal(n) + MEAN[i]
    np.save(folder / "axes.npy", axes)
    np.save(folder / "factors.npy", averaging_factors(n))
    todo = {stage: job for stage, _, job in jobs(folder, {"rest": "static"})}
    columns = dict(zip(CHANNELS, axes, strict=True))
    samples = pa.table({TIME: np.arange(n) / RATE, **columns}).cast(schema(False, {}))
    pq.write_table(samples, folder / "rest/samples.parquet", row_group_size=ROW_GROUP)
    run("segment", todo["segment"], folder)
    return todo["noise"]


def coefficients(path):
    """Return N and K of the accelerometer's axes of a noise.json, 0 where it gives none."""
    axes = json.loads(path.read_text())["axes"]
    return [[axes[name][term]["value"] or 0.0 for term in "NK"] for name in CHANNELS[:3]]


def reference(axes, factors):
    """Return the overlapping Allan deviation in extended precision, shape (6, k)."""
    found = np.empty((len(axes), len(factors)))
    for i, x in enumerate(axes):
        total = np.zeros(len(x) + 1, dtype=np.longdouble)
        np.cumsum(x.astype(np.longdouble) - x.mean(), out=total[1:])
        for k, m in enumerate(factors):
            second = total[2 * m :] - 2 * total[m:-m] + total[: -2 * m]
            found[i, k] = np.sqrt((second @ second) / len(second) / 2) / m
    return found
