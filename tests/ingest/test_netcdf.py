"""NetCDF logs."""

import netCDF4
import numpy as np
import pytest

from imuloop.core.errors import ImuloopError

pytestmark = pytest.mark.usefixtures("in_process")


@pytest.fixture
def write(log, tmp_path):
    def call(units="seconds since 2021-09-20 08:52:00", order=("time", "axis"), kind="f8"):
        path = tmp_path / "log.nc"
        with netCDF4.Dataset(path, "w") as data:
            data.createDimension("time", len(log))
            data.createDimension("axis", 3)
            for name, columns, unit in (
                ("acceleration", ["ax", "ay", "az"], "m/s2"),
                ("angular_velocity", ["gx", "gy", "gz"], "mrad/s"),
                ("magnetic_density", ["gx", "gy", "gz"], "uT"),
            ):
                variable = data.createVariable(name, "f8", order)
                values = log[columns].to_numpy()
                variable[:] = values if order[0] == "time" else values.T
                variable.units = unit
            time = data.createVariable("time", kind, ("time",), fill_value=False)
            time[:] = log.t if kind == "f8" else np.arange(len(log))
            if units:
                time.units = units
            temperature = data.createVariable("temperature", "f8", ("time",))
            temperature[:] = np.ma.masked_where(log.index == 9, 20.0 + log.t)
            temperature.units = "C"
        return path

    return call


@pytest.mark.parametrize("kind", ["f4", "f8"])
@pytest.mark.parametrize(
    "variant", ["NETCDF4", "NETCDF3_64BIT_DATA", "NETCDF4_CLASSIC", "NETCDF3_CLASSIC"]
)
def test_every_bit(hard, hard_stamps, every_bit, tmp_path, kind, variant):
    stamps = hard_stamps * 1e-9 if "CLASSIC" in variant else hard_stamps
    with netCDF4.Dataset(tmp_path / "log.nc", "w", format=variant) as data:
        data.createDimension("time", len(hard))
        data.createVariable("time", stamps.dtype, ("time",))[:] = stamps
        for name, column in zip(["ax", "ay", "az", "gx", "gy", "gz"], hard.T, strict=True):
            data.createVariable(name, kind, ("time",))[:] = column
    every_bit(tmp_path / "log.nc", hard.astype(kind), stamps)


@pytest.mark.parametrize("order", [("time", "axis"), ("axis", "time")])
def test_variables_with_an_axis_units_and_dates(log, run, write, order):
    done = run(write(order=order))
    np.testing.assert_array_equal(done.samples.ay, log.ay)
    np.testing.assert_allclose(done.samples.gz, 1e-3 * log.gz, rtol=1e-15)
    np.testing.assert_allclose(done.samples.t, log.t, atol=1e-9)
    np.testing.assert_array_equal(done.samples.temperature.isna(), log.index == 9)
    assert done.metadata["start"] == "2021-09-20T08:52:00Z"
    assert done.metadata["units"]["angular_rate"] == "mrad/s"
    assert "1 temperatures are missing" in done.quality["warnings"]


def test_whole_seconds_and_a_range_of_dates(run, write):
    done = run(write(kind="i8"), time_range=["2021-09-20T08:53", "2021-09-20 08:56:00"])
    assert len(done.samples) == 180
    assert done.samples.t.iloc[-1] == 179
    assert done.metadata["start"] == "2021-09-20T08:53:00Z"
    assert done.quality["outside_time_range"] == 320


def test_days_keep_nanoseconds(log, run, write):
    log["t"] /= 86400
    done = run(write(units="days since 2000-01-01"))
    np.testing.assert_allclose(done.samples.t, np.arange(500) / 100, atol=1e-8)


def test_declared_variables(log, run, write):
    path = write()
    columns = {"acceleration": "acceleration", "angular_rate": "magnetic_density"}
    done = run(path, columns=columns, units={"angular_rate": "rad/s"})
    np.testing.assert_array_equal(done.samples.gx, log.gx)
    with pytest.raises(ImuloopError, match=r"no column 'gyro.x'; there are acceleration.x"):
        run(path, columns={"angular_rate": "gyro"})


@pytest.mark.parametrize("date", ["0001-13-45", "0001-01-01"])
def test_units_that_are_no_date(run, write, date):
    [reason] = run(write(units=f"days since {date}")).quality["reasons"]
    assert reason == f"the stamps, days since {date}, are no dates of the years 1824 to 2115"


def test_units_that_are_not_known_or_differ(log, run, write):
    path = write()
    with netCDF4.Dataset(path, "a") as data:
        data["acceleration"].units = "furlong s-2"
    with pytest.raises(
        ImuloopError, match=r"units\.acceleration: the log says 'furlong s-2', which"
    ):
        run(path)
    done = run(path, units={"acceleration": "m/s^2"})
    np.testing.assert_array_equal(done.samples.ax, log.ax)
    columns = {"angular_rate": ["angular_velocity.x", "angular_velocity.y", "magnetic_density.z"]}
    with pytest.raises(ImuloopError, match=r"units\.angular_rate: the log says 'mrad/s and uT'"):
        run(path, columns=columns, units={"acceleration": "m/s^2"})


@pytest.mark.parametrize("unit", ["fortnights", "fortnights since 2021-09-20"])
def test_a_unit_of_time_that_is_not_known(log, run, write, unit):
    path = write(units=unit)
    np.testing.assert_array_equal(run(path, units={"time": "s"}).samples.t, log.t)
    with pytest.raises(ImuloopError, match=r"units\.time: the log says 'fortnights"):
        run(path)


def test_six_columns_in_one_variable(log, run, tmp_path):
    path = tmp_path / "log.nc"
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("time", len(log))
        data.createDimension("channel", 6)
        data.createVariable("time", "f8", ("time",))[:] = log.t.to_numpy()
        data.createVariable("imu", "f8", ("time", "channel"))[:] = log.iloc[:, 1:].to_numpy()
        data.createVariable("note", str, ("time",))
        data.createGroup("raw")
    with pytest.raises(ImuloopError) as raised:
        run(path)
    assert "found (time, imu.0, imu.1, imu.2, imu.3, imu.4, imu.5)" in str(raised.value)
    names = [f"imu.{i}" for i in range(6)]
    columns = {"acceleration": names[:3], "angular_rate": names[3:]}
    np.testing.assert_array_equal(run(path, columns=columns).samples.gz, log.gz)
