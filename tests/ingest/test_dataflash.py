"""ArduPilot DataFlash logs, written as the format defines them."""

from fractions import Fraction

import numpy as np
import pytest

from imuloop.core.errors import ImuloopError
from ingest.tables import ACCELERATION, RATE, same
from ingest.written import binary, packed, text

pytestmark = pytest.mark.usefixtures("in_process")

CHANNELS = RATE + ACCELERATION
# microseconds since the start
STAMPS = 987_654_321 + 10_003 * np.arange(500)
# messages of ArduPilot: format, names of the fields
IMU = "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"
OLD_IMU = "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
ACC = "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ"
GYR = "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"
IMT = "QBfffffffff", "TimeUS,I,DelT,DelvT,DelaT,DelAX,DelAY,DelAZ,DelVX,DelVY,DelVZ"


def imu(table, instance=0):
    warm = np.linspace(20, 30, 500, dtype=np.float32)
    rows = zip(STAMPS, table[CHANNELS].to_numpy(), warm, strict=True)
    return [(t, instance, *x, 0, 0, w, 1, 1, 1000, 1000) for t, x, w in rows]


def sampled(table, columns, instance=0, shift=0):
    rows = zip(STAMPS, table[columns].to_numpy(), strict=True)
    return [(t + 5000, instance, t + shift, *x) for t, x in rows]


@pytest.fixture
def single(log):
    return log.astype(np.float32).assign(t=(STAMPS - STAMPS[0]) * 1e-6)


@pytest.fixture
def write(tmp_path):
    def call(content, name="log.bin"):
        path = tmp_path / name
        path.write_bytes(content)
        return path

    return call


def test_imu_messages(run, single, write):
    path = write(binary(("IMU", IMU, imu(single))))
    done = run(path)
    assert same(done.samples, single)
    np.testing.assert_array_equal(done.samples.temperature, np.linspace(20, 30, 500).astype("f4"))
    assert done.quality["columns"]["acceleration"] == [f"IMU_0.Acc{axis}" for axis in "XYZ"]
    assert done.quality["bad_lines"] == 0
    assert "after its own calibration" in done.quality["warnings"][0]
    assert len(done.quality["warnings"]) == 1


NUMBERS = dict(f="f4", d="f8", b="i1", B="u1", h="i2", H="u2", i="i4", I="u4", q="i8")
SCALED = dict(c=("i2", 100), C=("u2", 100), e=("i4", 100), E=("u4", 100), L=("i4", 10_000_000))


@pytest.mark.parametrize("code", [*"fdBiqcL"])
def test_every_bit(hard, every_bit, write, code):
    kind, scale = SCALED.get(code) or (NUMBERS[code], 1)
    if kind in ("f4", "f8"):
        written = expected = hard.astype(kind)
    else:
        low, high = max(np.iinfo(kind).min, -(2**53)), min(np.iinfo(kind).max, 2**53)
        written = np.random.default_rng(5).integers(low, high, (300, 6))
        # the float64 nearest to the quotient
        expected = written / scale
    stamps = 2**60 + 1 + 10_003 * np.arange(300)
    rows = [(t, *row) for t, row in zip(stamps, written.tolist(), strict=True)]
    message = ("MINE", ("Q" + 6 * code, "TimeUS,ax,ay,az,gx,gy,gz"), rows)
    columns = dict(acceleration="MINE", angular_rate="MINE")
    path = write(binary(message))
    every_bit(path, expected, stamps, columns)


def test_every_bit_of_text(hard, every_bit, write):
    stamps = 1_700_000_000_123_457 + 10_003 * np.arange(300)
    rows = [(t, *row) for t, row in zip(stamps, hard.tolist(), strict=True)]
    content = text(("IMU", ("Qdddddd", "TimeUS,AccX,AccY,AccZ,GyrX,GyrY,GyrZ"), rows))
    every_bit(write(content, "log.txt"), hard, stamps.astype(float), format="dataflash")


def test_raw_messages_are_stamped_by_the_sample(run, single, write):
    messages = [
        ("ACC", ACC, sampled(single, ACCELERATION)),
        ("GYR", GYR, sampled(single, RATE)),
    ]
    assert same(run(write(binary(*messages))).samples, single)
    messages[1] = "GYR", GYR, sampled(single, RATE, shift=2_500)
    done = run(write(binary(*messages)))
    np.testing.assert_array_equal(done.samples.ax, single.ax)
    np.testing.assert_allclose(done.samples.t_accelerometer, done.samples.t - 2.5e-3, atol=1e-12)
    line = (
        "acceleration of ACC_0 has a clock of its own: each row of GYR_0 holds its nearest sample"
    )
    assert line in done.quality["warnings"]


def test_instances_are_chosen_by_name(run, single, write):
    path = write(binary(("IMU", IMU, [*imu(single + 1, 0), *imu(single, 2)])))
    with pytest.raises(ImuloopError, match=r"IMU_0 \(AccX.* and IMU_2 \(AccX.*all look like acc"):
        run(path)
    columns = {"acceleration": "IMU_2", "angular_rate": "IMU_2"}
    assert same(run(path, columns=columns).samples, single)
    columns["acceleration"] = [f"IMU_2.Acc{axis}" for axis in "XYZ"]
    assert same(run(path, columns=columns).samples, single)


def test_older_logs_number_the_message(run, single, write):
    rows = [(t // 1000, *x) for t, x in zip(STAMPS, single[CHANNELS].to_numpy(), strict=True)]
    path = write(binary(("IMU", OLD_IMU, rows), ("IMU2", OLD_IMU, rows)))
    done = run(path, columns={"acceleration": "IMU2", "angular_rate": "IMU2"})
    np.testing.assert_array_equal(done.samples[CHANNELS], single[CHANNELS].to_numpy(float))
    np.testing.assert_array_equal(
        done.samples.t, (STAMPS // 1000 - STAMPS[0] // 1000) * 1000 * 1e-6
    )


def test_increments_over_their_own_interval(run, single, write):
    dt = np.random.default_rng(3).uniform(0.009, 0.011, (500, 2)).astype("f4")
    dt[7] = 0
    change = single[CHANNELS].to_numpy() * dt[:, [1, 1, 1, 0, 0, 0]]
    rows = [(t, 0, 0.01, *d, *x) for t, d, x in zip(STAMPS, dt, change, strict=True)]
    done = run(write(binary(("IMT", IMT, rows))))
    kept = np.arange(500) != 7
    pairs = zip(change.tolist(), dt[:, [1, 1, 1, 0, 0, 0]].tolist(), strict=True)
    # the float64 nearest to the increment over its own interval
    quotients = [
        [float(Fraction(x) / Fraction(s)) if s else 0 for x, s in zip(*row, strict=True)]
        for row in pairs
    ]
    expected = np.array(quotients)[kept]
    np.testing.assert_array_equal(done.samples[CHANNELS], expected)
    assert done.quality["non_finite"] == 1


def test_a_log_cut_off_is_read_up_to_there(run, single, write):
    content = binary(("IMU", IMU, imu(single)))
    row = packed(IMU[0]).size
    for lost in (1, row - 1, row, 100 * row + 5):
        done = run(write(content[:-lost]))
        rows = (500 * row - lost) // row
        np.testing.assert_array_equal(done.samples.az, single.az[:rows])
        reported = f"{-lost % row} of {len(content) - lost} bytes are no message"
        assert (reported in done.quality["warnings"]) == bool(lost % row)
    for size in (1, 89, 89 * 3 + 20):
        assert run(write(content[:size])).quality["status"] == "rejected"


def test_a_text_log_cut_off(run, single, write):
    content = text(("IMU", IMU, imu(single)))
    done = run(write(content[:-5], "log.txt"), format="dataflash")
    assert len(done.samples) == 499 and done.quality["bad_lines"] == 1
    damaged = content.replace(b"\nIMU, 98", b"\nIMU, x\xff98", 3)
    done = run(write(damaged, "log.txt"), format="dataflash")
    assert len(done.samples) == 497 and done.quality["bad_lines"] == 3


@pytest.mark.parametrize("noise", [b"", bytes(5000), b"\xa3\x95" * 3000, b"FMT, 1\n" * 9])
def test_other_files_are_rejected(run, write, noise):
    done = run(write(binary(("MINE", ACC, []))))
    assert done.quality["reasons"] == ["the log holds no rows of IMU, ACC, GYR or IMT"]
    done = run(write(noise))
    assert done.quality["status"] == "rejected" and "\n" not in done.quality["reasons"][0]


def test_damage_costs_its_rows(run, single, write):
    content = binary(("IMU", IMU, imu(single)))
    row = packed(IMU[0]).size
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


@pytest.mark.parametrize("kind", [binary, text])
def test_a_message_that_is_defined_twice(run, single, write, kind):
    """Its fields are in another order from there on."""
    codes, names = IMU
    other = codes, names.replace("Gyr", "?").replace("Acc", "Gyr").replace("?", "Acc")
    rows = imu(single)
    if kind is binary:
        content = binary(("IMU", IMU, rows[:250]), ("IMU", other, rows[250:]))
    else:
        content = text(("IMU", IMU, rows[:250])) + text(("IMU", other, rows[250:]))
    line = "IMU is defined twice, with other fields: the log is of two kinds"
    assert run(write(content)).quality["reasons"] == [line]
