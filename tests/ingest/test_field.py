"""Logs as loggers in the field write them: what their headers, stamps and units look like."""

import zipfile

import numpy as np
import pandas as pd
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS
from imuloop.core.units import DEGREE

# --- two columns of time


@pytest.mark.parametrize(
    ("seconds", "part", "ns"),
    [
        ("header.stamp.sec", "header.stamp.nanosec", 1),
        ("%time.secs", "%time.nsecs", 1),
        ("tv_sec", "tv_usec", 1000),
        ("sec", "nanosec", 1),
    ],
)
def test_seconds_and_their_part_are_one_time(log, run, tmp_path, seconds, part, ns):
    path = tmp_path / "log.csv"
    stamps = 1_650_000_123_987_654_000 + 10_000_000 * np.arange(len(log))
    table = log.drop(columns="t")
    table.insert(0, part, stamps % 10**9 // ns)
    table.insert(0, seconds, stamps // 10**9)
    # receipt, late by up to 4 ms
    table.insert(0, "Time", stamps / 1e9 + np.arange(len(log)) % 5 / 1000)
    table.to_csv(path, index=False)
    done = run(path)
    np.testing.assert_allclose(done.samples.t, 0.01 * np.arange(len(log)), atol=1e-12)
    assert done.quality["columns"]["time"] == [seconds, part]
    assert done.metadata["start"] == "2022-04-15T05:22:03.987654Z"


def test_two_columns_of_time_are_declared(log, run, tmp_path):
    path = tmp_path / "log.csv"
    stamps = 1_650_000_123_900_000_000 + 10_000_000 * np.arange(len(log))
    table = log.assign(t=stamps // 10**9)
    table.insert(7, "part", stamps % 10**9)
    table.to_csv(path, index=False, header=False)
    columns = {"acceleration": [1, 2, 3], "angular_rate": [4, 5, 6]}
    done = run(path, columns=columns | {"time": [0, 7]}, units={"time": "s"})
    np.testing.assert_allclose(done.samples.t, 0.01 * np.arange(len(log)), atol=1e-12)
    table.to_csv(path, index=False)
    done = run(path, columns={"time": ["t", "part"]})
    assert done.quality["columns"]["time"] == ["t", "part"]
    assert len(done.samples) == len(log)


def test_a_part_of_more_than_a_second_is_none(log, run, tmp_path):
    log.insert(1, "nsec", 10**9 + np.arange(len(log)))
    log.rename(columns={"t": "sec"}).to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(ImuloopError, match="sec and nsec are not whole seconds and a part of a s"):
        run(tmp_path / "log.csv")


def test_time_goes_before_whole_seconds(log, run, tmp_path):
    log.insert(0, "header.stamp.secs", np.floor(log["t"]).astype(int))
    log.rename(columns={"t": "Time"}).to_csv(tmp_path / "log.csv", index=False)
    done = run(tmp_path / "log.csv")
    np.testing.assert_array_equal(done.samples.t, log["t"])


# --- text


def test_rows_that_begin_as_comments_do_are_shown(log, run, tmp_path):
    rows = log.to_csv(index=False, header=False).splitlines()
    (tmp_path / "log.csv").write_text("\n".join(f"%IMUA,{row}" for row in rows))
    [reason] = run(tmp_path / "log.csv").quality["reasons"]
    assert reason.startswith(
        "the file has no rows but lines that begin as comments do: '%IMUA,0.0,"
    )


def test_empty_fields_between_tabs(log, run, tmp_path):
    log.insert(3, "mag", "")
    log.insert(6, "note", "")
    log.to_csv(tmp_path / "log.txt", sep="\t", index=False)
    done = run(tmp_path / "log.txt")
    np.testing.assert_array_equal(done.samples[[*CHANNELS]], log[[*CHANNELS]])


def test_a_blank_before_quoted_names(log, run, tmp_path):
    log["t"] = 10_000 * np.arange(len(log))
    log[[*ANGULAR_RATE]] = (log[[*ANGULAR_RATE]] / DEGREE).round(4)
    names = ["time (us)", *ACCELERATION, *(f"gyroADC[{i}] (deg/s)" for i in range(3))]
    lines = [", ".join(f'"{name}"' for name in names)]
    lines += [", ".join(map(str, row)) for row in log.itertuples(index=False)]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    done = run(tmp_path / "log.csv")
    assert done.quality["columns"]["angular_rate"] == names[4:]
    assert done.metadata["units"]["time"] == "us"
    np.testing.assert_allclose(done.samples.gx, log.gx * DEGREE, rtol=1e-15)
    np.testing.assert_allclose(done.samples.t, 0.01 * np.arange(len(log)), atol=1e-12)


def arrows(log):
    """Return the stamps of a serial monitor, from a quarter to midnight on."""
    seconds = 85_500 + log["t"]
    return [f"{s // 3600:02.0f}:{s % 3600 // 60:02.0f}:{s % 60:06.3f} -> " for s in seconds]


@pytest.mark.parametrize("separator", [",", "\t", " "])
@pytest.mark.parametrize("headed", [True, False])
def test_a_time_and_an_arrow_before_each_line(log, run, tmp_path, separator, headed):
    rows = log[[*CHANNELS]].to_csv(sep=separator, index=False, header=False).splitlines()
    lines = [a + row for a, row in zip(arrows(log), rows, strict=True)]
    first = arrows(log)[0]
    before = [f"{first}sensor found", *[first + separator.join(CHANNELS)] * headed]
    (tmp_path / "log.txt").write_text("\n".join(before + lines) + "\n")
    # columns are counted after the arrow
    numbers = {"acceleration": [0, 1, 2], "angular_rate": [3, 4, 5]}
    done = run(tmp_path / "log.txt", columns={} if headed else numbers)
    assert (len(done.samples), done.quality["bad_lines"]) == (len(log), 0)
    np.testing.assert_array_equal(done.samples[[*CHANNELS]], log[[*CHANNELS]])
    np.testing.assert_allclose(done.samples.t, log.t, atol=1e-9)


@pytest.mark.parametrize("form", ["{}:{}", "{} = {}"])
@pytest.mark.parametrize("separator", [",", "\t", ", "])
def test_a_name_before_each_value(log, run, tmp_path, form, separator):
    names = ["t", "AccelX", "AccelY", "AccelZ", "GyroX", "GyroY", "GyroZ"]
    rows = log.itertuples(index=False)
    lines = [separator.join(map(form.format, names, row)) for row in rows]
    lines = [f"{arrow}{line}" for arrow, line in zip(arrows(log), lines, strict=True)]
    (tmp_path / "log.txt").write_text("\n".join([f"{arrows(log)[0]}ready: go", *lines]))
    done = run(tmp_path / "log.txt", columns={"time": "t"})
    np.testing.assert_array_equal(done.samples[[*log]], log)
    assert done.quality["columns"]["angular_rate"] == names[4:]


def test_names_in_two_rows(log, run, tmp_path):
    header = (
        "Time;Acceleration;;;Rate gyro;;\n;x;y;z;x;y;z\ns;m/s^2;m/s^2;m/s^2;rad/s;rad/s;rad/s\n"
    )
    path = tmp_path / "log.csv"
    path.write_text(header + log.to_csv(sep=";", index=False, header=False))
    done = run(path)
    np.testing.assert_array_equal(done.samples[[*CHANNELS]], log[[*CHANNELS]])
    assert done.quality["columns"]["angular_rate"] == [f"Rate gyro {a}" for a in "xyz"]


def test_text_below_the_names_costs_its_line(log, run, tmp_path):
    head, body = log.to_csv(index=False).split("\n", 1)
    (tmp_path / "log.csv").write_text(f"{head}\nstart,of,the,second,recording,at,noon\n{body}")
    done = run(tmp_path / "log.csv")
    np.testing.assert_array_equal(done.samples[[*log]], log)
    assert done.quality["bad_lines"] + done.quality["non_finite"] == 1


@pytest.mark.parametrize("form", ["%d-%b-%Y %H:%M:%S.%f", "%Y/%m/%d %H:%M:%S.%f"])
def test_dates_with_the_name_of_the_month(log, run, tmp_path, form):
    moments = pd.Timestamp("2023-02-28T23:59:58.500") + pd.to_timedelta(log.t, unit="s")
    moments.dt.strftime(form).rename("timestamp").to_frame().join(log[[*CHANNELS]]).to_csv(
        tmp_path / "log.csv", index=False
    )
    done = run(tmp_path / "log.csv")
    np.testing.assert_allclose(done.samples.t, log.t, atol=1e-9)
    assert done.metadata["start"] == "2023-02-28T23:59:58.500000Z"


def test_a_date_that_is_not_read_is_shown(log, run, tmp_path):
    log["t"] = [f"31.12.2023 12h{i}" for i in range(len(log))]
    log.to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(ImuloopError, match=r"column 't': '31\.12\.2023 12h0' is neither a number"):
        run(tmp_path / "log.csv")


@pytest.mark.parametrize(
    ("names", "quantity", "unit", "factor"),
    [
        ("Timestamp[nanosec],ax,ay,az,gx,gy,gz", "time", "ns", 1e-9),
        ("t [min],ax,ay,az,gx,gy,gz", "time", "min", 60),
        ("t,ax [ft/s²],ay [ft/s²],az [ft/s²],gx,gy,gz", "acceleration", "ft/s^2", 0.3048),
        ("t,ax,ay,az,gx [rpm],gy [rpm],gz [rpm]", "angular_rate", "rpm", np.pi / 30),
        ("t,ax,ay,az,gx,gy,gz,temp [°F]", "temperature", "degF", None),
    ],
)
def test_units_that_are_not_usual(log, run, tmp_path, names, quantity, unit, factor):
    log["temperature"] = 22.0 + log.t
    written = log.copy()
    parts = {"time": ["t"], "acceleration": [*ACCELERATION], "angular_rate": [*ANGULAR_RATE]}
    if factor:
        written[parts[quantity]] /= factor
    else:
        written["temperature"] = written["temperature"] * 9 / 5 + 32
    if unit == "ns":
        written["t"] = written["t"].round().astype(int)
    names = names if "temp" in names else f"{names},temp"
    body = written.to_csv(index=False, header=False)
    (tmp_path / "log.csv").write_text(f"{names}\n{body}", encoding="utf-8")
    done = run(tmp_path / "log.csv")
    assert done.metadata["units"][quantity] == unit
    np.testing.assert_allclose(done.samples[[*log]], log, rtol=1e-12, atol=1e-9)
    declared = run(tmp_path / "log.csv", units={quantity: unit}).samples
    np.testing.assert_array_equal(declared, done.samples)


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


# --- text of one maker


def test_scales_before_the_table_of_gyroflow(log, run, tmp_path):
    force, rate = 1 / 4096, 0.001
    lines = ["GYROFLOW IMU LOG", "version,1.3", "tscale,0.001", f"gscale,{rate}"]
    lines += [f"ascale,{force}", "t,gx,gy,gz,ax,ay,az"]
    table = np.column_stack([1000 * log.t, log[[*ANGULAR_RATE]], log[[*ACCELERATION]]])
    table[:, 1:] = np.round(table[:, 1:] / ([rate] * 3 + [force * 9.80665] * 3))
    rows = [",".join(f"{x:.0f}" for x in row) for row in table]
    path = tmp_path / "log.gcsv"
    path.write_text("\n".join([*lines, *rows]))
    done = run(path)
    np.testing.assert_allclose(done.samples.t, log.t)
    np.testing.assert_allclose(done.samples.gx, table[:, 1] * rate)
    np.testing.assert_allclose(done.samples.ax, table[:, 4] * force * 9.80665)
    # what is declared goes first
    done = run(path, nominal={"angular_rate": {"scale": 2 * rate}})
    np.testing.assert_allclose(done.samples.gx, 2 * table[:, 1] * rate)
    path.write_text("\n".join([*lines[:4], "ascale,?", lines[5], *rows]))
    assert "look like counts" in run(path).quality["reasons"][0]


def test_messages_of_novatel(log, run, tmp_path):
    force, rate = 1e-6, 1e-8
    table = np.column_stack(
        [
            log.t,
            *(log[a] / force for a in ("az", "ay", "ax")),
            *(log[a] / rate for a in ("gz", "gy", "gx")),
        ]
    )
    table = np.round(table * [1, 1, -1, 1, 1, -1, 1], 2)
    rows = [
        f"%RAWIMUSA,2304,{t + 7:.3f};2304,{t + 7:.6f},00000077,"
        + ",".join(f"{x:.0f}" for x in values) + "*1a2b3c4d"
        for t, *values in table
    ]  # fmt: skip
    path = tmp_path / "log.asc"
    path.write_text("\r\n".join(rows))
    with pytest.raises(ImuloopError, match=r"needs nominal\.acceleration\.scale \(increments: ×"):
        run(path)
    nominal = {"acceleration": {"scale": force}, "angular_rate": {"scale": rate}}
    done = run(path, nominal=nominal)
    np.testing.assert_allclose(done.samples.t, log.t, atol=1e-9)
    for name in CHANNELS:
        np.testing.assert_allclose(done.samples[name], log[name], atol=force)


# --- signs


def test_a_sign_is_turned_by_the_name_of_a_column(log, run, tmp_path):
    turned = log.assign(ay=-log.ay, gz=-log.gz)
    turned.to_csv(tmp_path / "log.csv", index=False)
    columns = {"acceleration": ["ax", "-ay", "az"], "angular_rate": ["gx", "gy", "-gz"]}
    done = run(tmp_path / "log.csv", columns=columns)
    np.testing.assert_array_equal(done.samples[[*CHANNELS]], log[[*CHANNELS]])
    turned.to_csv(tmp_path / "log.csv", index=False, header=False)
    columns = {"time": 0, "acceleration": [1, "-2", 3], "angular_rate": [4, 5, "-6"]}
    done = run(tmp_path / "log.csv", columns=columns)
    np.testing.assert_array_equal(done.samples[[*CHANNELS]], log[[*CHANNELS]])
    with pytest.raises(ImuloopError, match="no column 'az2'"):
        turned.to_csv(tmp_path / "log.csv", index=False)
        run(tmp_path / "log.csv", columns={"acceleration": ["ax", "ay", "-az2"]})


def test_the_sign_of_lpms_is_turned(log, run, tmp_path):
    """Protects from a calibration with every force reversed, which nothing else shows."""
    names = ["SensorId", "TimeStamp (s)", "FrameNumber"]
    names += [f"Acc{a} (g)" for a in "XYZ"] + [f"Gyro{a} (deg/s)" for a in "XYZ"]
    table = np.column_stack(
        [
            *(np.ones(len(log)), log.t, np.arange(len(log))),
            *(-log[a] / 9.80665 for a in ACCELERATION),
            *(log[a] / DEGREE for a in ANGULAR_RATE),
        ]
    )
    lines = [", ".join(map(repr, row)) for row in table.tolist()]
    (tmp_path / "log.csv").write_text("\n".join([", ".join(names), *lines]))
    done = run(tmp_path / "log.csv")
    np.testing.assert_allclose(done.samples[[*CHANNELS]], log[[*CHANNELS]], rtol=1e-12)
    assert any("sign of its acceleration is turned" in line for line in done.quality["warnings"])
