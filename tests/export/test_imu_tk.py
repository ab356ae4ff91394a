"""imu_tk's text calibrations, read as its own reader does."""

import numpy as np
import pytest

from export.devices import HOSTILE, device, samples, unknown, without_effects
from imuloop.core.errors import Lacking
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.export.imu_tk import ACCELEROMETER, GYROSCOPE

SENSORS = {"accelerometer": (ACCELEROMETER, ACCELERATION), "gyroscope": (GYROSCOPE, ANGULAR_RATE)}


def load(text):
    """Return T, K, b as CalibratedTriad::load: 9, 9 and 3 numbers, parted by white space."""
    numbers = np.array(text.split()[:21], dtype=float)
    return numbers[:9].reshape(3, 3), numbers[9:18].reshape(3, 3), numbers[18:]


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_same_calibrated_samples(sensor):
    written, columns = SENSORS[sensor]
    board, table = device(), samples()
    raw = board.sensor(sensor).raw_unit.from_si(table[list(columns)])
    T, K, b = load(written.text(board))
    # unbiasNormalize: T K (X - B)
    found = (raw - b) @ (T @ K).T
    expected = without_effects(board).apply(table)[list(columns)]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14 * 20)


@pytest.mark.parametrize("sensor", SENSORS)
def test_its_misalignment_is_written_as_it_reads_it(sensor):
    T, K, _ = load(SENSORS[sensor][0].text(device()))
    assert np.diag(T).tolist() == [1, 1, 1]
    assert np.count_nonzero(K - np.diag(np.diag(K))) == 0
    assert (np.tril(T, -1) == 0).all() == (sensor == "accelerometer")


def test_units_and_what_is_left_out_are_said_below_the_numbers():
    lines = GYROSCOPE.text(device()).splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("#"))
    assert len(" ".join(lines[:first]).split()) == 21
    below = "\n".join(lines[first:])
    assert "rad/s per deg/s" in below
    assert "Effect not carried: g_sensitivity" in below


def test_a_label_adds_nothing():
    plain, hostile = (load(ACCELEROMETER.text(device(label))) for label in ("Board", HOSTILE))
    for one, other in zip(plain, hostile, strict=True):
        assert (one == other).all()


@pytest.mark.parametrize("sensor", SENSORS)
def test_no_file_of_what_was_not_measured(sensor):
    with pytest.raises(Lacking, match="no calibration"):
        SENSORS[sensor][0].text(unknown())
