"""The two sensors of a text log apart: in turn, in their own files, in rows of each."""

import zipfile

import numpy as np
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from ingest.logs import RATE, brief
from ingest.text_forms import SIX, lines, text


def in_turn(count=3000, rate=250.0, share=3, empty=np.nan, both=False):
    """A table of which each row holds one sensor alone, or of which each so many hold the force."""
    log, force = brief(count), np.arange(count) % share == share - 1
    log["t"] = np.arange(count) / rate
    log.loc[~force, [*ACCELERATION]] = empty
    if not both:
        log.loc[force, [*ANGULAR_RATE]] = empty
    return log


@pytest.mark.parametrize("empty", [0.0, np.nan])
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_rows_of_two_sensors_in_turn_are_two_streams(run, tmp_path, empty, ending):
    table, path = in_turn(empty=empty), tmp_path / f"log.{ending}"
    table.to_parquet(path) if ending == "parquet" else path.write_text(text(table))
    done = run(path)
    assert done.quality["status"] == "ok"
    assert "the rows hold the accelerometer and the gyroscope in turn" in done.quality["warnings"]
    # those of the sensor whose clock is the log's are as they were logged
    assert max(np.isin(done.samples[c], table[c]).mean() for c in ("ax", "gx")) == 1


def test_an_outer_join_of_two_rates_keeps_all_samples_zeros_too(run):
    table = in_turn(2000, 200.0, 4, both=True)
    done = run(table)
    assert done.quality["status"] == "ok"
    assert all(np.isin(done.samples[c], table[c]).all() for c in SIX)
    table = in_turn(1000, 200.0, 2)
    zeros = np.arange(1000)[:, None] // 4 % 2 * [1.0, 2.0, 1.0]
    table[RATE] = np.where(table[RATE].isna(), np.nan, zeros)
    done = run(table, units={"angular_rate": "deg/s"})
    assert done.quality["gaps"]["count"] == 0 and len(done.samples) >= 499


def test_a_gyroscope_of_whole_degrees_at_rest_takes_no_turns(log, run):
    log[RATE] = 0.0
    log.loc[::2, "gz"] = 1.0
    quality = run(log, units={"angular_rate": "deg/s"}).quality
    assert not any("in turn" in line for line in quality["warnings"])


def two_clocks(log):
    """Return tables of an accelerometer at 100 Hz and of a gyroscope that is 1.5 ms later."""
    force = log[["t", *ACCELERATION]].set_axis([*"txyz"], axis=1)
    rate = log[["t", *ANGULAR_RATE]].set_axis([*"txyz"], axis=1)
    return force, rate.assign(t=log.t + 0.0015)


@pytest.fixture
def is_two(log):
    def check(done):
        assert done.quality["status"] == "ok", done.quality["reasons"]
        assert 480 <= len(done.samples) <= len(log) and 4.9 < done.quality["duration_s"] < 5
        # those of the sensor whose clock is the log's are as they were logged
        assert max(np.isin(done.samples[c], log[c]).mean() for c in ("ax", "gx")) == 1

    return check


def written(paths, tables, form):
    for path, table, unit in zip(paths, tables, ("m/s²", "rad/s"), strict=True):
        ms, uvw = (1000 * table.t).round(3), dict(u=1.0, v=2.0, w=3.0)
        if form == "parquet":
            table.to_parquet(path)
            continue
        if form == "axes":
            names = ["elapsed (ms)", *(f"{a}-axis ({unit})" for a in "xyz")]
            table = table.assign(t=ms).set_axis(names, axis=1).assign(pressure=1013.0)
        elif form == "declared":
            table = table.assign(**uvw)
            if unit == "rad/s":
                table = table.assign(t=ms).rename(columns={"t": "t (ms)"})
        elif form == "week":
            table = table.rename(columns={"t": "t (week)"})
        path.write_text(text(table, header=form != "headless", sep=" ,"[form != "headless"]))


@pytest.mark.parametrize(
    ("form", "time", "unit"),
    [("csv", "t", "s"), ("parquet", "t", "s"), ("headless", "0", "s"),
     ("axes", "elapsed (ms)", "ms"), ("declared", None, None), ("week", "t (week)", "s")],
)  # fmt: skip
def test_two_files_of_any_table_are_one_log(log, run, tmp_path, is_two, form, time, unit):
    paths = [tmp_path / f"{name}.{'parquet' if form == 'parquet' else 'txt'}" for name in "ab"]
    written(paths, two_clocks(log), form)
    declared = {}
    if form == "declared":
        declared = {"columns": {"acceleration": [*"xyz"], "angular_rate": [*"xyz"]}}
    elif form == "week":
        with pytest.raises(ImuloopError, match=r"units\.time: the log says 'week'"):
            run(*paths)
        declared = {"units": {"time": "s"}}
    done = run(*paths, **declared)
    is_two(done)
    if unit:
        assert done.metadata["units"]["time"] == unit
        assert done.quality["columns"]["time"] == time


@pytest.mark.parametrize("zipped", ["one", "two"])
def test_tables_in_a_zip_are_read(log, run, tmp_path, is_two, zipped):
    tables = {"rec/imu.csv": log}
    if zipped == "two":
        tables = dict(zip(("rec/Accel.txt", "rec/gyro.txt"), two_clocks(log), strict=True))
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
        for name, table in tables.items():
            content = text(table, header=zipped == "one", sep=" ,"[zipped == "one"])
            archive.writestr(name, "# made by a logger\n" + content)
        archive.writestr("rec/notes.md", "at noon")
    done = run(tmp_path / "log.zip")
    is_two(done)
    assert "of the zip" in done.quality["warnings"][0]


@pytest.mark.parametrize("head", ["column", "comments"])
def test_rows_that_begin_with_the_name_of_the_sensor_are_read(log, run, tmp_path, is_two, head):
    every, names = ["sensor,time,x,y,z"], ("accelerometer", "gyroscope")
    tables = two_clocks(log)
    if head == "comments":
        names = ("UncalAccel", "UncalGyro")
        every = ["# Fix,provider,time"]
        every += ["# UncalAccel,elapsedRealtimeNanos,AccelXMps2,AccelYMps2,AccelZMps2,BiasXMps2"]
        every += ["# UncalGyro,elapsedRealtimeNanos,GyroXRadPerSec,GyroYRadPerSec,GyroZRadPerSec"]
        force, rate = (x.assign(t=(1e9 * x.t).round().astype(int)) for x in tables)
        tables = force.assign(bias=0.0), rate
    for pair in zip(*(lines(table, header=False) for table in tables), strict=True):
        every += [f"{name},{row}" for name, row in zip(names, pair, strict=True)]
        every += ["Fix,gps,1"] * (head == "comments")
    (tmp_path / "log.txt").write_text("\n".join(every))
    done = run(tmp_path / "log.txt")
    is_two(done)
    assert done.metadata["units"]["time"] == ("ns" if head == "comments" else "s")


@pytest.mark.parametrize("time", ["t", "host"])
def test_a_table_of_each_sensor_below_the_other_is_read(run, tmp_path, time):
    """Protects the second table: of it nothing is in the first rows."""
    force, rate = two_clocks(brief(3000))
    every = []
    for name, table, step in (("Gyro", rate, 0.0025), ("Accel", force[::2], 0.005)):
        rows = lines(table.assign(t=np.arange(len(table)) * step), header=False)
        every += ["", f"type,{time},3DOF_x,3DOF_y,3DOF_z", *(f"{name},{row}" for row in rows)]
    (tmp_path / "log.csv").write_text("\n".join(every))
    if time == "host":
        with pytest.raises(ImuloopError, match=r"no time column of a usual name .*host.* not as"):
            run(tmp_path / "log.csv")
    done = run(tmp_path / "log.csv", columns={"time": time})
    np.testing.assert_array_equal(done.samples[RATE].iloc[9:99], rate.iloc[9:99, 1:])
    assert np.isin(done.samples.ax, force.x).all()
