"""What NetCDF files hold beside one table of columns."""

import netCDF4
import numpy as np
import pytest

from imuloop.core.errors import ImuloopError
from ingest.written import ACCELERATION, RATE


@pytest.fixture
def netcdf(log, tmp_path):
    """Write vectors with an axis, units, a date, and a temperature of which one is missing."""

    def call(units="seconds since 2021-09-20 08:52:00", order=("time", "axis"), kind="f8"):
        # what was read in this process stays open
        path = tmp_path / f"{len([*tmp_path.iterdir()])}.nc"
        with netCDF4.Dataset(path, "w") as data:
            data.createDimension("time", len(log))
            data.createDimension("axis", 3)
            for name, columns, unit in (
                ("acceleration", ACCELERATION, "m/s2"),
                ("angular_velocity", RATE, "mrad/s"),
                ("magnetic_density", RATE, "uT"),
            ):
                values = log[columns].to_numpy()
                variable = data.createVariable(name, "f8", order)
                variable[:], variable.units = values if order[0] == "time" else values.T, unit
            time = data.createVariable("time", kind, ("time",), fill_value=False)
            time[:], time.units = log.t if kind == "f8" else np.arange(len(log)), units
            temperature = data.createVariable("temperature", "f8", ("time",))
            temperature[:] = np.ma.masked_where(log.index == 9, 20.0 + log.t)
            temperature.units = "C"
        return path

    return call


@pytest.mark.parametrize("order", [("time", "axis"), ("axis", "time")])
def test_variables_with_an_axis_units_and_dates_are_read(log, run, netcdf, order):
    done = run(netcdf(order=order))
    np.testing.assert_array_equal(done.samples.ay, log.ay)
    np.testing.assert_allclose(done.samples.gz, 1e-3 * log.gz, rtol=1e-15)
    np.testing.assert_allclose(done.samples.t, log.t, atol=1e-9)
    np.testing.assert_array_equal(done.samples.temperature.isna(), log.index == 9)
    assert done.metadata["start"] == "2021-09-20T08:52:00Z"
    assert done.metadata["units"]["angular_rate"] == "mrad/s"
    assert "1 temperatures are missing" in done.quality["warnings"]
    # whole seconds, and a range of dates
    done = run(netcdf(kind="i8"), time_range=["2021-09-20T08:53", "2021-09-20 08:56:00"])
    assert len(done.samples) == 180 and done.samples.t.iloc[-1] == 179
    assert done.metadata["start"] == "2021-09-20T08:53:00Z"
    assert done.quality["outside_time_range"] == 320
    # days keep nanoseconds
    log["t"] /= 86400
    done = run(netcdf(units="days since 2000-01-01"))
    np.testing.assert_allclose(done.samples.t, np.arange(500) / 100, atol=1e-8)


@pytest.mark.parametrize("date", ["0001-13-45", "0001-01-01"])
def test_units_of_time_that_are_no_date_reject_the_log(run, netcdf, date):
    [reason] = run(netcdf(units=f"days since {date}")).quality["reasons"]
    assert reason == f"the stamps, days since {date}, are no dates of the years 1824 to 2115"


def test_units_of_variables_that_are_not_known_are_one_line_unless_declared(log, run, netcdf):
    path = netcdf()
    columns = {"acceleration": "acceleration", "angular_rate": "magnetic_density"}
    done = run(path, columns=columns, units={"angular_rate": "rad/s"})
    np.testing.assert_array_equal(done.samples.gx, log.gx)
    with pytest.raises(ImuloopError, match=r"no column 'gyro.x'; there are acceleration.x"):
        run(path, columns={"angular_rate": "gyro"})
    mixed = {"angular_rate": ["angular_velocity.x", "angular_velocity.y", "magnetic_density.z"]}
    with pytest.raises(ImuloopError, match=r"units\.angular_rate: the log says 'mrad/s and uT'"):
        run(path, columns=mixed)
    for unit in ("fortnights", "fortnights since 2021-09-20"):
        path = netcdf(units=unit)
        np.testing.assert_array_equal(run(path, units={"time": "s"}).samples.t, log.t)
        with pytest.raises(ImuloopError, match=r"units\.time: the log says 'fortnights"):
            run(path)


def test_six_columns_in_one_variable_are_declared_by_number(log, run, tmp_path):
    path = tmp_path / "log.nc"
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("time", len(log))
        data.createDimension("channel", 6)
        data.createVariable("time", "f8", ("time",))[:] = log.t.to_numpy()
        data.createVariable("imu", "f8", ("time", "channel"))[:] = log.iloc[:, 1:].to_numpy()
        data.createVariable("note", str, ("time",))
        data.createGroup("raw")
    names = [f"imu.{i}" for i in range(6)]
    with pytest.raises(ImuloopError, match=rf"found \(time, {', '.join(names)}\)"):
        run(path)
    columns = {"acceleration": names[:3], "angular_rate": names[3:]}
    np.testing.assert_array_equal(run(path, columns=columns).samples.gz, log.gz)
