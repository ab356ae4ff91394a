"""Settings of the diagnosis."""

from dataclasses import dataclass

from imuloop.core.setting import setting

# number of kinds of residuals of a device, which share the significance: gravity norm, pose rate,
# rotation, two of velocity, and for each sensor the bias at rest and the comparison to a reference
RESIDUALS = 9


@dataclass(frozen=True)
class DiagnoseSettings:
    """Settings of the diagnosis."""

    significance: float = setting(0.05, "Probability of a false alarm of the tests", gt=0, lt=1)
    family: int = setting(
        1, "Devices judged as one family: the false alarm is that of any of them", ge=1
    )
    power: float = setting(
        0.9,
        "Probability with which an effect of the size of its detection limit is found",
        gt=0,
        lt=1,
    )
    folds: int = setting(10, "Parts that the poses are split into, each held out once", ge=2)
    blocks: int = setting(8, "Parts in time of a static record, each held out once", ge=2)
    mean_time: float = setting(
        60.0,
        "Static records are compared with their floor as means of so many s, longer where that "
        "would give more than 200",
        gt=0,
    )

    @property
    def residual_significance(self):
        """Significance for one kind of residual of one device.

        Residuals with a smaller p-value are larger than the noise explains. The value is the
        significance of all kinds and devices together, divided by the number of kinds of residuals,
        and by the number of devices of the family.
        """
        return self.significance / RESIDUALS / self.family
