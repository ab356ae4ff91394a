"""Logs as loggers in the field write them: what their headers, stamps and units look like."""

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
