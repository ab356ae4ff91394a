"""Allan deviation of an ADIS16405 at rest against the one published with the recording."""

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from imuloop.noise.allan import allan_variance

RATE = 100.0


@pytest.mark.parametrize("axis", ["ax", "ay", "az", "gx", "gy", "gz"])
def test_overlapping_deviation_agrees_with_the_published_one(recordings, axis):
    x = pq.read_table(recordings("adis_16405_imu1.parquet"), columns=[axis])[axis].to_numpy()
    published = pd.read_csv(recordings("published_adev.csv"))
    name = {"a": "accel_", "g": "gyro_"}[axis[0]] + axis[1]
    published = published[published["axis"] == name]
    # published in the recording's own units, deg/s and g, at tau = 0.02 s * 2^k
    factors = np.rint(published["tau_or_level"].to_numpy() * RATE).astype(int)
    assert list(factors) == [2 << k for k in range(18)]
    deviation = np.sqrt(allan_variance([x.astype(float)], factors))
    assert deviation == pytest.approx(published["adev"].to_numpy(), rel=3e-6)
