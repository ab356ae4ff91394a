"""Logs that need no declaration, and their near neighbours, which do."""

import numpy as np
import pytest

import imuloop
from imuloop.core.errors import ImuloopError
from ingest.text_forms import SIX

EPOCH = 1_700_000_000


def named(log, header, time=1.0, start=0):
    """The log as CSV with these names; its times are in another unit."""
    table = log.assign(t=start + np.round(log.t * time).astype(int) if time > 1 else log.t)
    names = header.split()
    extra = {f"more{i}": 20.0 + log.t for i in range(len(names) - 7)}
    return table.assign(**extra).to_csv(index=False, header=names)


SIX_OF = "{0}ax {0}ay {0}az {0}gx {0}gy {0}gz".format
# how a log is written: names, and in what units; and the units that quality.json then says
HEADERS = {
    f"imu0_time {SIX_OF('imu0_')} imu0_temp": ({}, {"temperature": "degC"}),
    # 100 us in an MTi; us in a DOT
    "SampleTimeFine Acc_X Acc_Y Acc_Z Gyr_X Gyr_Y Gyr_Z":
        ({"time": 1e4, "start": 77}, {"time": "us"}),
    "Sample_Time_Fine Acc_X Acc_Y Acc_Z Gyr_X Gyr_Y Gyr_Z": ({"time": 1e6}, {"time": "us"}),
    **{f"{name} {SIX_OF('')}": ({"time": ticks, "start": EPOCH * int(ticks)}, {"time": unit})
       for name, ticks, unit in (("t", 1e3, "ms"), ("timestamp", 1e6, "us"), ("stamp", 1e9, "ns"))},
}  # fmt: skip


@pytest.mark.parametrize("header", HEADERS)
def test_names_and_stamps_are_recognised(log, run, tmp_path, header):
    how, units = HEADERS[header]
    (tmp_path / "log.csv").write_text(named(log, header, **how))
    done = run(tmp_path / "log.csv")
    assert (done.quality["status"], done.quality["warnings"]) == ("ok", [])
    np.testing.assert_allclose(done.samples[SIX], log[SIX], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(done.samples.t, log.t, rtol=0, atol=1e-9)
    assert done.metadata["units"] == done.metadata["units"] | units
    assert ("temperature" in done.samples) == ("temperature" in units)


def test_each_entry_reads_a_new_format(log, tmp_path):
    (tmp_path / "log.json").write_text(log.to_json(orient="records", lines=True))
    np.testing.assert_allclose(imuloop.read(tmp_path / "log.json")[SIX], log[SIX], rtol=1e-9)
    np.save(tmp_path / "log.bin", log.to_records(index=False))
    (tmp_path / "log.bin.npy").rename(tmp_path / "log.bin")
    for how in ({}, {"format": "numpy"}):
        assert imuloop.read(tmp_path / "log.bin", **how)[SIX].equals(log[SIX])


# --- near neighbours


@pytest.mark.parametrize(
    ("header", "line"),
    [
        (f"seconds {SIX_OF('')} minutes", "no time column of a usual name"),
        (f"hour {SIX_OF('')} minute seconds", "no time column of a usual name"),
        (f"t {SIX_OF('imu0_')} {SIX_OF('imu1_')}", "imu0_ax/imu0_ay/imu0_az and imu1_ax/"),
        # of a foot's force, and of odometry
        (f"t foot_fx foot_fy foot_fz {SIX_OF('')[9:]}", "no columns of acceleration found"),
        (f"t {SIX_OF('')[:9]} odom_wx odom_wy odom_wz", "no columns of angular_rate found"),
        (f"t {SIX_OF('')[:9]} roll_x_deg roll_y_deg roll_z_deg", "no columns of angular_rate"),
    ],
)
def test_what_can_be_meant_in_two_ways_is_asked(log, run, tmp_path, header, line):
    (tmp_path / "log.csv").write_text(named(log, header))
    with pytest.raises(ImuloopError, match=line):
        run(tmp_path / "log.csv")


def test_nanoseconds_since_the_start_are_no_date(log, run, tmp_path):
    """Protects from a rate of 0.0001 Hz: as ms since 1970 20 minutes in ns are in 2008."""
    (tmp_path / "log.csv").write_text(named(log, f"t {SIX_OF('')}", 1e9, start=1_200_000_000_000))
    assert run(tmp_path / "log.csv").quality["status"] == "rejected"
    assert run(tmp_path / "log.csv", units={"time": "ns"}).quality["status"] == "ok"


def test_a_damaged_line_of_json_costs_itself(log, run, tmp_path):
    lines = log.to_json(orient="records", lines=True).splitlines()
    lines[7], lines[9], lines[11] = lines[7][:30], "[" * 5000, '{"ax": 1}'
    (tmp_path / "log.jsonl").write_text("\n".join(lines))
    done = run(tmp_path / "log.jsonl")
    assert (done.quality["rows"], done.quality["bad_lines"]) == (497, 2)
