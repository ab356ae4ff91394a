"""Settings of the diagnosis."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DiagnoseSettings:
    """Settings of the diagnosis.

    Attributes
    ----------
    significance : float
        Probability of a false alarm of the tests.
    family : int
        Devices that are judged as one family: the probability of a false alarm is that of any of
        them.
    power : float
        Probability with which an effect of the size of its detection limit is found.
    folds : int
        Parts that the poses are split into, each held out once.
    blocks : int
        Parts that a static record is split into in time, each held out once.
    mean_time : float
        Seconds over which a static record is averaged before it is compared with its floor; longer
        where that would give more than 2000 means.
    draws : int
        Bootstrap draws for the interval of a ratio of held-out errors.
    seed : int
        Seed of the bootstrap.
    """

    significance: float = 0.05
    family: int = 1
    power: float = 0.9
    folds: int = 10
    blocks: int = 8
    mean_time: float = 60.0
    draws: int = 2000
    seed: int = 0
