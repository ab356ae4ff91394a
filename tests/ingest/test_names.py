"""Which columns of a log hold what, by their names, and which names are asked about."""

import re

import pytest

from imuloop.core.errors import ImuloopError
from imuloop.ingest.columns import resolve
from imuloop.ingest.spellings import SENSORS, TABLE, stated_unit

SIX = "ax,ay,az,gx,gy,gz"


def each(*names):
    """The names of a table, in which *, & and # stand for axes: x y z, X Y Z and 0 1 2."""
    every = ",".join(names).split(",")
    for sign, axes in (("*", "xyz"), ("&", "XYZ"), ("#", "012")):
        every = [n.replace(sign, a) for n in every for a in (axes if sign in n else "-")]
    return every


# How loggers call their columns (`each` says what the signs stand for); where time, the first axis
# of each sensor and the temperature are; the units that the names say of t, a, w (rate) and T. Last
# come loggers that are published: NGIMU, Xsens MTi, OpenLog Artemis, Betaflight, GoPro,
# AndroSensor, Physics Toolbox, two of WitMotion, LPMS, ADIS, Inertial Sense, Axivity, PlotJuggler,
# OxIOD (no specific force), Delsys, ulog2csv, DatCon, Tobii, Shimmer, VectorNav, MicroStrain,
# gnss-ins-sim, ST, RaceBox, Kalibr, an IMU topic as text by two scripts, Zurich Urban MAV.
LOGGERS = """
timestamp,a*,w*,temperature | 0 1 4 7 |
timestamp,imu.acc.*,imu.gyro.*,imu.temperature | 0 1 4 7 |
time,*acc,*gyro,temperature | 0 1 4 7 |
stamp,linear_acceleration.*,angular_velocity.* | 0 1 4 - |
time_us,accelerometer_*,gyroscope_*,temp_c | 0 1 4 7 | t us, T degC
t,imu.delta_velocity.*,imu.delta_angle.* | 0 1 4 - | a m/s, w rad
t,deltaVel&,deltaAng& | 0 1 4 - | a m/s, w rad
t,delta_velocity[#],dang[#] | 0 1 4 - | a m/s, w rad
timestamp [ns],a* (g),gyro_*_dps,temp (°C) | 0 1 4 7 | t ns, a g, w deg/s, T degC
t,a* [furlong],g* | 0 1 4 - | a furlong
t,a*_cms2,g* [°/s] | 0 1 4 - | a cm/s^2, w deg/s
t [min],a* [m s-2],g*_rpm | 0 1 4 - | t min, a m/s^2, w rpm
t [µs],a* [m·s⁻²],g* [mrad/s] | 0 1 4 - | t us, a m/s^2, w mrad/s
t,acc_*_g,g* / dps | 0 1 4 - | a g, w deg/s
t,a*,g*_deg_s,temp_f | 0 1 4 7 | w deg/s, T degF
t,a*,gyro_*_raw | 0 1 4 - | w count
t,a*,gyro[#] [] | 0 1 4 - |
t,a*,gyro_*_deg | 0 1 4 - | w deg/s
t,dv*,da* [deg] | 0 1 4 - | a m/s, w deg
t,a*,g*,dv*,da*,dt | 0 1 4 - |
t,accuracy_*,gyro_*,accel_bias_* | 0 - 4 - |
T(°),Time(s),a*,g* | 1 2 5 - | t s
T [K],Time (UTC),a*,g* | 1 2 5 - | t UTC
millis,a*,g* | 0 1 4 - | t ms
UTC_Hour,UTC_Minute,sampleTimeMillis,timestamp_ms,a*,g* | 3 4 7 - | t ms
%time,field.header.seq,field.header.stamp,a*,g* | 2 3 6 - |
Time (s),Gyroscope & (deg/s),Accelerometer & (g),Magnetometer & (uT) | 0 4 1 - | t s, a g, w deg/s
PacketCounter,SampleTimeFine,Acc_&,FreeAcc_&,Gyr_&,Mag_& | 1 2 8 - |
rtcDate,rtcTime,a&,g&,m&,imu_degC,output_Hz | 1 2 5 11 | T degC
timeITOW,time,*Accel,*Rate,*Mag,temp | 1 2 5 11 |
time (s),*Accel (m/s/s),*Rate (deg/s) | 0 1 4 - | t s, a m/s^2, w deg/s
loopIteration,time (us),axisP[#],gyroADC[#],accSmooth[#] | 1 8 5 - | t us
cts,date,Accelerometer (*) [m/s²],Gyroscope (*) [rad/s] | 1 2 5 - | a m/s^2, w rad/s
ACCELEROMETER & (g),LINEAR ACCELERATION &,GYROSCOPE &,Time since start in ms | 9 0 6 - | t ms, a g
time,gF*,w*,B* | 0 1 4 - |
Time,Chip Time(),Acceleration &(g),Angular velocity &,Temperature(℃) | 0 2 5 8 | a g, T degC
Time,ChipTime,Acc&(g),As&(°/s),Angle&(°) | 0 2 5 - | a g, w deg/s
SensorId,TimeStamp (s),Acc& (g),Gyro& (deg/s),LinAcc& (g) | 1 2 5 - | t s, a g, w deg/s
Sample,&_GYRO_OUT,&_ACCL_OUT | - 4 1 - |
time,pqr[#],acc[#] | 0 4 1 - |
Time,Accel-& (g),Gyro-& (d/s) | 0 1 4 - | a g, w deg/s
__time,/imu/data/angular_velocity/*,/imu/data/linear_acceleration/* | 0 4 1 - |
Time,rotation_rate_*(radians/s),gravity_*(G),user_acc_*(G) | 0 - 1 - | w rad/s
X[s],Avanti sensor 1: ACC.& 1 [g],Avanti sensor 1: GYRO.& 1 [deg/s] | - 1 4 - | a g, w deg/s
timestamp,gyro_rad[#],gyro_integral_dt,accelerometer_m_s2[#] | 0 5 1 - | a m/s^2, w rad/s
Tick,IMU_ATTI(0):accel&,IMU_ATTI(0):gyro&,IMU_ATTI(0):temp | - 1 4 7 |
Recording timestamp [μs],Gyro & [°/s],Accelerometer & [m/s²] | 0 4 1 - | t us, a m/s^2, w deg/s
Shimmer_AB_Timestamp_Unix_CAL,Shimmer_AB_Accel_LN_&_CAL,Shimmer_AB_Gyro_&_CAL | 0 1 4 - |
TimeStartup,UncompAccel&,UncompGyro&,Temp | 0 1 4 7 |
UTC Timestamp,scaledAccel&,scaledGyro& | 0 1 4 - |
ref_time (sec),accel_* (m/s^2),gyro_* (deg/s) | 0 1 4 - | t s, a m/s^2, w deg/s
time [s],f_ib_b_* [m/s^2],omega_ib_b_* [rad/s] | 0 1 4 - | t s, a m/s^2, w rad/s
millis,acc_*_mg,gyr_*_mdps | 0 1 4 - | t ms, a mg, w mdeg/s
Record,Time,Speed,GForce&,Lap,Gyro& | 1 3 7 - |
timestamp,omega_*,alpha_* | 0 4 1 - |
remote_timestamp,ang_vel_*,lin_acc_*,host_time | 0 4 1 - |
time,sensor,tof_distance,accel *,angular_vel * | 0 3 6 - |
Timpstemp,Omega_*,Accel_*,Vel_*,AccBias_* | 0 4 1 - |
seconds,f_*,omega_* | 0 1 4 - | t s
timestamp [ns],w_RS_S_* [rad s^-1],a_RS_S_* [m s^-2] | 0 4 1 - | t ns, a m/s^2, w rad/s
t,left.a*,left.g*,imu_degC | 0 1 4 7 | T degC
t,a*,g*,temp_degC | 0 1 4 7 | T degC
t,a*,gyro_dps_* | 0 1 4 - | w deg/s
t,a*,gyro&dps | 0 1 4 - | w deg/s
t,a*,*_dps | 0 1 4 - | w deg/s
t,imu0_a*,imu0_g*_dps | 0 1 4 - | w deg/s
""".strip().splitlines()


@pytest.mark.parametrize("line", LOGGERS)
def test_the_columns_and_units_of_a_logger_are_known(line):
    header, places, units = (part.strip() for part in line.split("|"))
    found = resolve(each(header))
    force, rate = (at and at[0] for at in (found.acceleration, found.angular_rate))
    places = [None if place == "-" else int(place) for place in places.split()]
    assert [found.time, force, rate, found.temperature] == places
    quantities = dict(t="time", a="acceleration", w="angular_rate", T="temperature")
    said = (text.split() for text in units.split(", ") if text)
    assert found.units == {quantities[letter]: unit for letter, unit in said}


def test_each_line_of_the_table_is_read():
    """Protects those who add a name or a unit there: that is all they have to do."""
    for quantity, kinds in TABLE["columns"].items():
        for kind, name in ((k, n) for k, names in kinds.items() for n in names if k != "words"):
            columns = [f"{name} {axis}" for axis in "xyz"] if quantity in SENSORS else [name]
            others = {q: None for q in SENSORS if q != quantity}
            found = resolve(columns, others).found(columns)
            assert found == {quantity: columns if quantity in SENSORS else name} or (
                quantity == "interval" and kind == "names"
            )
    for quantity, units in TABLE["units"].items():
        for unit, spelt in units.items():
            for text in (unit, *spelt):
                assert unit in (stated_unit(quantity, text), stated_unit(quantity, text, True))


@pytest.mark.parametrize(
    "six",
    ["a*,acc_*", "a*,raw_a*", "a*,gF*", "acc_*_g,acc_*_mps2", "imu.acc.*,raw.acc.*",
     "acc[#],imu_acc[#]"],
)  # fmt: skip
def test_two_accelerometers_must_be_distinguished(six):
    first, last = each(six)[:3], each(six)[3:]
    line = re.escape(f"{'/'.join(first)} and {'/'.join(last)} both look like acceleration; name ")
    with pytest.raises(ImuloopError, match=line):
        resolve(each("t", six, "g*"))
    assert resolve(each("t", six, "g*"), {"acceleration": last}).acceleration == (4, 5, 6)


@pytest.mark.parametrize(
    ("names", "columns", "line"),
    [
        ("t,x,x,z,g*", {"acceleration": ["x", "x", "z"]}, "2 columns are named 'x'"),
        (f"t,{SIX}", {"acceleration": "ax"}, "not a list of three"),
        (f"t,u,v,{SIX}", {"time": ["t", "u", "v"]}, "is not a column, nor two of whole seconds"),
        (f"t,{SIX}", {"time": "ax"}, "column 1, 'ax', is already in columns.time"),
        # what repeats is not chosen by its place
        (f"t,{SIX},ax", {}, "both look like acceleration; .* by number from 0 to 7"),
        (f"t,{SIX},AX", {}, "both look like acceleration"),
        (f"t,T,{SIX}", {}, "t and T both look like time"),
        (f"t,{SIX},temp,temp", {}, "both look like temperature"),
    ],
)
def test_columns_that_cannot_be_chosen_are_one_line(names, columns, line):
    with pytest.raises(ImuloopError, match=line):
        resolve(each(names), columns)
