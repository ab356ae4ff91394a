"""Logs that hold the two sensors apart: rows in turn, a table, a file or rows of each."""

import zipfile

import numpy as np
import pandas as pd
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS

# --- two sensors in one table


@pytest.mark.parametrize("empty", [0.0, np.nan])
def test_rows_of_two_sensors_in_turn(log, run, tmp_path, empty):
    table = pd.concat([log] * 6, ignore_index=True)
    table["t"] = np.arange(len(table)) / 250
    force = np.arange(len(table)) % 3 == 1
    table.loc[~force, [*ACCELERATION]] = empty
    table.loc[force, [*ANGULAR_RATE]] = empty
    table.to_csv(tmp_path / "log.csv", index=False)
    table.to_parquet(tmp_path / "log.parquet")
    found = [run(tmp_path / name) for name in ("log.csv", "log.parquet")]
    for done in found:
        assert done.quality["status"] == "ok"
        line = "the rows hold the accelerometer and the gyroscope in turn"
        assert line in done.quality["warnings"]
        # those of the sensor whose clock is the log's are as they were logged
        assert max(np.isin(done.samples[c], table[c]).mean() for c in ("ax", "gx")) == 1
    pd.testing.assert_frame_equal(found[0].samples, found[1].samples)


def test_an_outer_join_of_two_rates(log, run, tmp_path):
    table = pd.concat([log] * 4, ignore_index=True)
    table["t"] = np.arange(len(table)) / 200
    table.loc[np.arange(len(table)) % 4 > 0, [*ACCELERATION]] = np.nan
    table.to_csv(tmp_path / "log.csv", index=False)
    done = run(tmp_path / "log.csv")
    assert done.quality["status"] == "ok"
    assert all(np.isin(done.samples[c], table[c]).all() for c in CHANNELS)


def test_an_outer_join_keeps_samples_that_are_zero(log, run, tmp_path):
    table = pd.concat([log] * 2, ignore_index=True)
    table["t"] = np.arange(len(table)) / 200
    table[[*ANGULAR_RATE]] = np.arange(len(table))[:, None] // 4 % 2 * [1.0, 2.0, 1.0]
    table.loc[::2, [*ACCELERATION]] = np.nan
    table.loc[1::2, [*ANGULAR_RATE]] = np.nan
    table.to_csv(tmp_path / "log.csv", index=False)
    done = run(tmp_path / "log.csv", units={"angular_rate": "deg/s"})
    assert done.quality["gaps"]["count"] == 0 and len(done.samples) >= 499


def test_two_files_whose_unit_of_time_is_not_known(log, run, tmp_path):
    for name, table in zip("ab", two_clocks(log), strict=True):
        header = ["t (week)", "x", "y", "z"]
        table.to_csv(tmp_path / f"{name}.csv", index=False, header=header)
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    with pytest.raises(ImuloopError, match=r"units\.time: the log says 'week'"):
        run(*paths)
    check_two(run(*paths, units={"time": "s"}), log)


def test_a_gyroscope_of_whole_degrees_at_rest_takes_no_turns(log, run, tmp_path):
    log[[*ANGULAR_RATE]] = 0.0
    log.loc[::2, "gz"] = 1.0
    log.to_csv(tmp_path / "log.csv", index=False)
    quality = run(tmp_path / "log.csv", units={"angular_rate": "deg/s"}).quality
    assert not any("in turn" in text for text in quality["warnings"])


# --- a table, a file or rows of each sensor


def two_clocks(log):
    """Return tables of an accelerometer at 100 Hz and of a gyroscope that is 1.5 ms later."""
    force = log[["t", *ACCELERATION]].set_axis(["t", "x", "y", "z"], axis=1)
    rate = log[["t", *ANGULAR_RATE]].set_axis(["t", "x", "y", "z"], axis=1)
    return force, rate.assign(t=log.t + 0.0015)


def check_two(done, log, rows=480):
    assert done.quality["status"] == "ok", done.quality["reasons"]
    assert rows <= len(done.samples) <= len(log)
    # those of the sensor whose clock is the log's are as they were logged
    assert max(np.isin(done.samples[c], log[c]).mean() for c in ("ax", "gx")) == 1


@pytest.mark.parametrize("form", ["csv", "parquet", "headless", "axes"])
def test_two_files_of_any_table(log, run, tmp_path, form):
    tables = two_clocks(log)
    paths = [tmp_path / f"{name}.{'parquet' if form == 'parquet' else 'txt'}" for name in "ab"]
    for path, table, unit in zip(paths, tables, ("m/s²", "rad/s"), strict=True):
        if form == "parquet":
            table.to_parquet(path)
        elif form == "axes":
            names = ["elapsed (ms)", *(f"{a}-axis ({unit})" for a in "xyz")]
            scaled = table.assign(t=(1000 * table.t).round(3), pressure=1013.0)
            scaled.to_csv(path, index=False, header=[*names, "pressure"])
        else:
            table.to_csv(path, index=False, header=form == "csv", sep=" ,"[form == "csv"])
    done = run(*paths)
    check_two(done, log)
    assert done.metadata["units"]["time"] == ("ms" if form == "axes" else "s")
    assert done.quality["columns"]["time"] == {"axes": "elapsed (ms)", "headless": "0"}.get(
        form, "t"
    )


def test_two_files_with_declared_columns_and_units_of_time(log, run, tmp_path):
    force, rate = two_clocks(log)
    rate["t"] = (1000 * rate.t).round(3)
    force.assign(u=1.0, v=2.0, w=3.0).to_csv(tmp_path / "a.csv", index=False)
    names = ["t (ms)", "x", "y", "z", "u", "v", "w"]
    rate.assign(u=1.0, v=2.0, w=3.0).to_csv(tmp_path / "b.csv", index=False, header=names)
    columns = {"acceleration": ["x", "y", "z"], "angular_rate": ["x", "y", "z"]}
    done = run(tmp_path / "a.csv", tmp_path / "b.csv", columns=columns)
    check_two(done, log)
    assert 4.9 < done.quality["duration_s"] < 5


@pytest.mark.parametrize("zipped", ["one", "two"])
def test_tables_in_a_zip(log, run, tmp_path, zipped):
    tables = {"rec/imu.csv": log}
    if zipped == "two":
        tables = dict(zip(("rec/Accel.txt", "rec/gyro.txt"), two_clocks(log), strict=True))
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
        for name, table in tables.items():
            text = table.to_csv(index=False, header=zipped == "one", sep=" ,"[zipped == "one"])
            archive.writestr(name, "# made by a logger\n" + text)
        archive.writestr("rec/notes.md", "at noon")
    done = run(tmp_path / "log.zip")
    check_two(done, log)
    assert "of the zip" in done.quality["warnings"][0]


def test_a_zip_of_tables_that_do_not_say_what_they_are(log, run, tmp_path):
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
        for name in ("a.csv", "b.csv"):
            archive.writestr(name, log.to_csv(index=False))
    [reason] = run(tmp_path / "log.zip").quality["reasons"]
    assert "nor one whose name says acc and one gyr, but 'a.csv', 'b.csv'" in reason


@pytest.mark.parametrize("head", ["column", "comments"])
def test_rows_that_begin_with_the_name_of_the_sensor(log, run, tmp_path, head):
    lines, names = ["sensor,time,x,y,z"], ("accelerometer", "gyroscope")
    force, rate = two_clocks(log)
    if head == "comments":
        names = ("UncalAccel", "UncalGyro")
        lines = ["# Fix,provider,time"]
        lines += ["# UncalAccel,elapsedRealtimeNanos,AccelXMps2,AccelYMps2,AccelZMps2,BiasXMps2"]
        lines += ["# UncalGyro,elapsedRealtimeNanos,GyroXRadPerSec,GyroYRadPerSec,GyroZRadPerSec"]
        force, rate = (x.assign(t=(1e9 * x.t).round().astype(int)) for x in (force, rate))
        force["bias"] = 0.0
    texts = [table.to_csv(index=False, header=False).splitlines() for table in (force, rate)]
    for pair in zip(*texts, strict=True):
        lines += [f"{name},{row}" for name, row in zip(names, pair, strict=True)]
        lines += ["Fix,gps,1"] * (head == "comments")
    (tmp_path / "log.txt").write_text("\n".join(lines))
    done = run(tmp_path / "log.txt")
    check_two(done, log)
    assert done.metadata["units"]["time"] == ("ns" if head == "comments" else "s")


@pytest.mark.parametrize("timed", [True, False])
def test_a_table_of_each_sensor_below_the_other(log, run, tmp_path, timed):
    """Protects the second table: of it nothing is in the first rows."""
    force, rate = (pd.concat([x] * 6, ignore_index=True) for x in two_clocks(log))
    time = "t" if timed else "host"
    header = f"type,{time},3DOF_x,3DOF_y,3DOF_z"
    lines = []
    for name, table, step in (("Gyro", rate, 0.0025), ("Accel", force[::2], 0.005)):
        rows = table.assign(t=np.arange(len(table)) * step).to_csv(index=False, header=False)
        lines += ["", header, *(f"{name},{row}" for row in rows.splitlines())]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    if not timed:
        with pytest.raises(
            ImuloopError, match=r"no time column of a usual name .*host.* not as ma"
        ):
            run(tmp_path / "log.csv")
    done = run(tmp_path / "log.csv", columns={"time": time})
    np.testing.assert_array_equal(done.samples[[*ANGULAR_RATE]].iloc[9:99], rate.iloc[9:99, 1:])
    assert np.isin(done.samples.ax, force.x).all()


def test_columns_of_a_sensor_that_end_before_the_others(log, run, tmp_path):
    """Protects from a log rejected for rows that are of another sensor, as of EMG beside an IMU."""
    names = ["X[s]", "EMG1", "X[s]"]
    names += [f"{s}1.{a}" for s in ("ACC", "GYRO") for a in "XYZ"]
    other = pd.DataFrame({"s": np.arange(1500) / 300, "emg": 0.5})
    pd.concat([other, log], axis=1).to_csv(tmp_path / "log.csv", index=False, header=names)
    with pytest.raises(ImuloopError, match="no time column of a usual name"):
        run(tmp_path / "log.csv")
    done = run(tmp_path / "log.csv", columns={"time": 2})
    np.testing.assert_array_equal(done.samples, log)
    assert (done.quality["status"], done.quality["non_finite"]) == ("ok", 0)
