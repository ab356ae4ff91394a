"""A bias that changes evenly with time within a static record."""

from imuloop.effects.bias_drift import BiasDrift


class Ramp(BiasDrift):
    """``e_i = d_i t``: between poses this is `bias_drift`.

    Leaves: levels that change evenly. Imitated by: `bias_temperature` where the temperature only
    rises or falls, a long `warm_up`, and random walk, which the noise of the test allows for.
    """

    name = "ramp"
    timed = False
    records = ("static_record",)
    lasting = False
