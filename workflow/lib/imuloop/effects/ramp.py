"""A bias that changes evenly with time within a static record."""

from dataclasses import dataclass

from imuloop.effects.bias_drift import BiasDrift


@dataclass(frozen=True)
class Ramp(BiasDrift):
    """``e_i = d_i t``: the bias changes evenly with time, from the start of each log.

    The same as `bias_drift` between poses. Imitated by: `bias_temperature` where the temperature
    only rises or falls, a long `warm_up`, and random walk, which the noise of the test allows for.
    """

    name = "ramp"
    timed = False
    records = ("static_record",)
    lasting = False
