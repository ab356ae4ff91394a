"""A sensor whose samples are stamped too late or too early."""

from imuloop.core.effect import Effect


class TimeOffset(Effect):
    """``e = Δt dy/dt``: the sensor shows what was Δt ago (negative) or will be.

    Leaves: while the device turns, gravity's direction from the accelerometer runs behind that
    from the gyroscope by w Δt. From rest to rest both have arrived: the angle turned is the same.
    """

    name = "time_offset"
    parameters = {"dt": "s"}
    equation = "e = Δt dy/dt"
    reference = "Furgale et al., IROS 2013, temporal calibration"
    records = ("poses",)
    unobservable = "a shift in time changes nothing at rest, nor the angle from rest to rest"
