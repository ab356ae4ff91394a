"""Logs of ArduPilot, beside the round trip: DataFlash."""

import numpy as np
import pytest

from imuloop.core.errors import ImuloopError
from ingest import written
from ingest.autopilots import STAMPS, WARM, of_own_interval
from ingest.written import ACCELERATION, RATE

# format and names of the fields of messages of ArduPilot
MESSAGE = "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"
OLD = "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
ACC = "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ"
GYR = "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"
IMT = "QBfffffffff", "TimeUS,I,DelT,DelvT,DelaT,DelAX,DelAY,DelAZ,DelVX,DelVY,DelVZ"


def imu(table, instance=0):
    rows = zip(STAMPS, table[RATE + ACCELERATION].to_numpy(), WARM, strict=True)
    return [(t, instance, *x, 0, 0, w, 1, 1, 1000, 1000) for t, x, w in rows]


def sampled(table, columns, shift=0):
    rows = zip(STAMPS.tolist(), table[columns].to_numpy(), strict=True)
    return [(t + 5000, 0, t + shift, *x) for t, x in rows]


@pytest.fixture
def write(tmp_path):
    def call(content):
        (tmp_path / "log.bin").write_bytes(content)
        return tmp_path / "log.bin"

    return call


@pytest.fixture
def dataflash(write):
    return lambda *messages: write(written.binary(*messages))


def test_messages_of_ardupilot_are_read_and_chosen_by_instance(run, single, dataflash, same):
    done = run(dataflash(("IMU", MESSAGE, imu(single))))
    same(done, single)
    np.testing.assert_array_equal(done.samples.temperature, WARM)
    assert done.quality["columns"]["acceleration"] == [f"IMU_0.Acc{axis}" for axis in "XYZ"]
    assert done.quality["bad_lines"] == 0
    [note] = done.quality["warnings"]
    assert "after its own calibration" in note
    path = dataflash(("IMU", MESSAGE, [*imu(single + 1, 0), *imu(single, 2)]))
    with pytest.raises(ImuloopError, match=r"IMU_0 \(AccX.* and IMU_2 \(AccX.*all look like acc"):
        run(path)
    for acceleration in ("IMU_2", [f"IMU_2.Acc{axis}" for axis in "XYZ"]):
        columns = {"acceleration": acceleration, "angular_rate": "IMU_2"}
        same(run(path, columns=columns), single)
    # older logs number the message, and count ms
    ms = (STAMPS // 1000).astype(int)
    rows = [(t, *x) for t, x in zip(ms, single[RATE + ACCELERATION].to_numpy(), strict=True)]
    columns = {"acceleration": "IMU2", "angular_rate": "IMU2"}
    done = run(dataflash(("IMU", OLD, rows), ("IMU2", OLD, rows)), columns=columns)
    same(done, single.assign(t=(ms - ms[0]) * 1e-3))


def test_raw_messages_are_stamped_by_the_sample(run, single, dataflash, same):
    force = "ACC", ACC, sampled(single, ACCELERATION)
    same(run(dataflash(force, ("GYR", GYR, sampled(single, RATE)))), single)
    done = run(dataflash(force, ("GYR", GYR, sampled(single, RATE, shift=2_500))))
    np.testing.assert_array_equal(done.samples.ax, single.ax)
    np.testing.assert_allclose(done.samples.t_accelerometer, done.samples.t - 2.5e-3, atol=1e-12)
    line = "acceleration of ACC_0 has a clock of its own: each row of GYR_0 holds its nearest samp"
    assert any(text.startswith(line) for text in done.quality["warnings"])


def test_increments_of_ardupilot_are_of_their_own_interval(run, single, dataflash):
    dt = np.random.default_rng(3).uniform(0.009, 0.011, (500, 2)).astype("f4")
    dt[7] = 0
    change = single[RATE + ACCELERATION].to_numpy() * dt[:, [1, 1, 1, 0, 0, 0]]
    rows = [(t, 0, 0.01, *d, *x) for t, d, x in zip(STAMPS, dt, change, strict=True)]
    done = run(dataflash(("IMT", IMT, rows)))
    expected = of_own_interval(change, dt[:, [1, 1, 1, 0, 0, 0]], 1)
    np.testing.assert_array_equal(done.samples[RATE + ACCELERATION], expected)
    assert done.quality["non_finite"] == 1


def test_a_dataflash_log_cut_off_is_read_up_to_there(run, single, write):
    content, row = written.binary(("IMU", MESSAGE, imu(single))), written.packed(MESSAGE[0]).size
    for lost in (1, row - 1, row, 100 * row + 5):
        done = run(write(content[:-lost]))
        np.testing.assert_array_equal(done.samples.az, single.az[: (500 * row - lost) // row])
        reported = f"{-lost % row} of {len(content) - lost} bytes are no message"
        assert (reported in done.quality["warnings"]) == bool(lost % row)
    for size in (1, 89, 89 * 3 + 20):
        assert run(write(content[:size])).quality["status"] == "rejected"
    content = written.text(("IMU", MESSAGE, imu(single)))
    damaged = content.replace(b"\nIMU, 12345", b"\nIMU, x\xff12345", 3)
    for text, lost in ((content[:-5], 1), (damaged, 3)):
        done = run(write(text), format="dataflash")
        assert (len(done.samples), done.quality["bad_lines"]) == (500 - lost, lost)


def test_damage_to_a_dataflash_log_costs_its_rows(run, single, write):
    content, row = written.binary(("IMU", MESSAGE, imu(single))), written.packed(MESSAGE[0]).size
    begin = len(content) - 250 * row + 7
    noise = np.random.default_rng(2).bytes(200).replace(b"\xa3", b"\xa4")
    done = run(write(content[:begin] + noise + content[begin + 200 :]))
    lost = 1 + (7 + 200 - 1) // row
    # the row before the damage is whole: a header follows it
    rows = np.r_[0:250, 250 + lost : 500]
    np.testing.assert_array_equal(done.samples.az, single.az.to_numpy(float)[rows])
    assert f"{lost * row} of {len(content)} bytes are no message" in done.quality["warnings"]
    # a message of an unknown number ends the library's index, not the log
    at = len(content) - 100 * row + 2
    done = run(write(content[:at] + b"\x11" + content[at + 1 :]))
    assert len(done.samples) == 499
    # an instance that is there once is no second sensor
    done = run(write(content[: at + 9] + b"\x4d" + content[at + 10 :]))
    assert len(done.samples) == 499 and done.quality["bad_lines"] == 1


@pytest.mark.parametrize("noise", [b"", bytes(5000), b"\xa3\x95" * 3000, b"FMT, 1\n" * 9])
def test_what_is_no_dataflash_log_is_rejected(run, write, dataflash, noise):
    done = run(dataflash(("MINE", ACC, [])))
    assert done.quality["reasons"] == ["the log holds no rows of IMU, ACC, GYR or IMT"]
    [reason] = run(write(noise)).quality["reasons"]
    assert "\n" not in reason


def test_a_message_that_is_defined_twice_with_other_fields_rejects_the_log(run, single, write):
    codes, names = MESSAGE
    other = codes, names.replace("Gyr", "?").replace("Acc", "Gyr").replace("?", "Acc")
    rows = imu(single)
    halves = ("IMU", MESSAGE, rows[:250]), ("IMU", other, rows[250:])
    line = "IMU is defined twice, with other fields: the log is of two kinds"
    for content in (written.binary(*halves), b"".join(map(written.text, halves))):
        assert run(write(content)).quality["reasons"] == [line]
