"""Logs that need no declaration, and their near neighbours, which do."""

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

import imuloop
from imuloop.core.errors import ImuloopError
from imuloop.core.units import STANDARD_GRAVITY
from ingest.logs import FORCE, RATE
from ingest.text_forms import SIX, text
from ingest.written import matlab_73

EPOCH = 1_700_000_000
EVEN = np.arange(500)


def named(log, header, time=1.0, start=0):
    """The log as CSV with these names; its times are in another unit."""
    table = log.assign(t=start + np.round(log.t * time).astype(int) if time > 1 else log.t)
    names = header.split()
    extra = {f"more{i}": 20.0 + log.t for i in range(len(names) - 7)}
    return table.assign(**extra).to_csv(index=False, header=names)


def gcsv(log, tick=1e-3, head="GYROFLOW", rates_alone=False, said=True):
    """A log of Gyroflow: counts, with the scales above."""
    columns = [np.round(log.t / tick), log[RATE] / 1e-6, log[FORCE] / 1e-6][
        : 2 if rates_alone else 3
    ]
    rows = [",".join(f"{x:.0f}" for x in row) for row in np.column_stack(columns)]
    scales = [f"tscale,{tick:.7f}"] * said + ["gscale,1e-6"]
    scales += [f"ascale,{1e-6 / STANDARD_GRAVITY!r}"] * (not rates_alone)
    names = "t,gx,gy,gz" if rates_alone else "t,gx,gy,gz,ax,ay,az"
    return "\n".join([f"{head} IMU LOG", "version,1.3", "orientation,YxZ", *scales, names, *rows])


SIX_OF = "{0}ax {0}ay {0}az {0}gx {0}gy {0}gz".format
# how a log is written: names, and in what units; and the units that quality.json then says
HEADERS = {
    f"imu0_time {SIX_OF('imu0_')} imu0_temp": ({}, {"temperature": "degC"}),
    # 100 us, as of an MTi; us, as of a DOT
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


@pytest.mark.parametrize(
    ("how", "absent"),
    [
        *(({"tick": tick}, None) for tick in (0.0018, 1e-4, 1 / 128, 1e-6)),
        ({"head": "CAMERA"}, None),
        ({"said": False}, None),
        ({"rates_alone": True}, "acceleration"),
    ],
)
def test_logs_of_gyroflow_have_any_tick(log, run, tmp_path, how, absent):
    log["t"] = EVEN * (5 * how["tick"] if how.get("tick", 0) > 1e-4 else 0.01)
    (tmp_path / "log.gcsv").write_text(gcsv(log, **how))
    done = run(tmp_path / "log.gcsv")
    assert done.quality["status"] == "ok", done.quality["reasons"]
    names = RATE if absent else SIX
    np.testing.assert_allclose(done.samples[names], log[names], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(done.samples.t, log.t, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["log.npy", "log.npz", "log.mat", "73.mat"])
@pytest.mark.parametrize("first", [FORCE, RATE])
def test_the_columns_of_a_matrix_of_seven_are_those_that_gravity_shows(
    log, run, tmp_path, name, first
):
    rest = RATE if first == FORCE else FORCE
    matrix = log[["t", *first, *rest]].to_numpy()
    write = {
        "log.npy": lambda path: np.save(path, matrix),
        "log.npz": lambda path: np.savez(path, matrix),
        "log.mat": lambda path: savemat(path, {"data": matrix}),
        "73.mat": lambda path: matlab_73(path, {"data": matrix}),
    }[name]
    write(tmp_path / name)
    done = run(tmp_path / name)
    np.testing.assert_array_equal(done.samples[SIX], log[SIX])
    assert "which gravity tells apart" in done.quality["warnings"][0]
    # in g it does not, as 1 is the size of many things
    matrix[:, 1:] /= STANDARD_GRAVITY
    write(tmp_path / name)
    with pytest.raises(ImuloopError, match="no header, 7 columns"):
        run(tmp_path / name)


@pytest.mark.parametrize("name", ["log.npy", "log.mat"])
def test_the_columns_of_a_matrix_are_declared_by_number(log, run, tmp_path, name):
    wide = np.column_stack([log[["t", *SIX]], np.zeros((500, 3))])
    np.save(tmp_path / name, wide) if name == "log.npy" else savemat(tmp_path / name, {"x": wide})
    with pytest.raises(ImuloopError, match=r"10 columns.*acceleration, such as \[1, 2, 3\]"):
        run(tmp_path / name)
    columns = {"time": 0, "acceleration": [1, 2, 3], "angular_rate": [4, 5, 6]}
    np.testing.assert_array_equal(run(tmp_path / name, columns=columns).samples[SIX], log[SIX])


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


def test_seconds_and_their_part_are_one_time(log, run, tmp_path):
    for part, ticks in (("nanoseconds", 10**9), ("microseconds", 10**6), ("milliseconds", 1000)):
        table = log.assign(**{part: np.round(log.t % 1 * ticks).astype(int)})
        table = table.rename(columns={"t": "seconds"}).astype({"seconds": int})
        (tmp_path / "log.csv").write_text(text(table))
        np.testing.assert_allclose(run(tmp_path / "log.csv").samples.t, log.t, rtol=0, atol=1e-9)


def test_usual_names_go_before_those_with_a_prefix(log, run, tmp_path):
    table = pd.concat([log, log[SIX].add_prefix("imu1_") + 1, log.t.rename("imu1_time")], axis=1)
    (tmp_path / "log.csv").write_text(text(table.assign(seconds=0, SampleTimeFine=log.t * 2)))
    done = run(tmp_path / "log.csv")
    np.testing.assert_array_equal(done.samples[["t", *SIX]], log[["t", *SIX]])


def test_an_empty_column_of_ticks_leaves_the_declared_rate(log, run, tmp_path):
    """Protects logs of Xsens without ticks, whose rate is declared: the column is there, empty."""
    table = log.rename(columns={"t": "SampleTimeFine"}).assign(SampleTimeFine="")
    (tmp_path / "log.csv").write_text(text(table))
    np.testing.assert_allclose(run(tmp_path / "log.csv", rate=100).samples.t, log.t, atol=1e-9)


def test_a_declared_unit_goes_before_that_of_the_stamps(log, run, tmp_path):
    (tmp_path / "log.csv").write_text(named(log, f"t {SIX_OF('')}", 1e3, start=EPOCH * 1000))
    done = run(tmp_path / "log.csv", units={"time": "us"})
    assert done.quality["rate_hz"] == pytest.approx(1e5, rel=1e-6)
    assert "units.time is us, the log says ms; us used" in done.quality["warnings"]


def test_nanoseconds_since_the_start_are_no_date(log, run, tmp_path):
    """Protects from a rate of 0.0001 Hz: as ms since 1970 20 minutes in ns are in 2008."""
    (tmp_path / "log.csv").write_text(named(log, f"t {SIX_OF('')}", 1e9, start=1_200_000_000_000))
    assert run(tmp_path / "log.csv").quality["status"] == "rejected"
    assert run(tmp_path / "log.csv", units={"time": "ns"}).quality["status"] == "ok"


@pytest.mark.parametrize("before", ['{"device": "imu"}', "[INFO] started", "{", "a | b", "t|ax"])
def test_lines_before_a_table_make_it_no_json_and_no_table_of_pipes(log, run, tmp_path, before):
    (tmp_path / "log.csv").write_text(f"{before}\n{text(log)}")
    np.testing.assert_array_equal(run(tmp_path / "log.csv").samples[SIX], log[SIX])


def test_a_damaged_line_of_json_costs_itself(log, run, tmp_path):
    lines = log.to_json(orient="records", lines=True).splitlines()
    lines[7], lines[9], lines[11] = lines[7][:30], "[" * 5000, '{"ax": 1}'
    (tmp_path / "log.jsonl").write_text("\n".join(lines))
    done = run(tmp_path / "log.jsonl")
    assert (done.quality["rows"], done.quality["bad_lines"]) == (497, 2)
