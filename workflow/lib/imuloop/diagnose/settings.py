"""Settings of the diagnosis."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DiagnoseSettings:
    """Settings of the diagnosis; the schema of the config describes each."""

    significance: float = 0.05
    # devices that share the probability of a false alarm
    family: int = 1
    power: float = 0.9
    # parts that the poses, and a static record in time, are split into: each held out once
    folds: int = 10
    blocks: int = 8
    # s over which a static record is averaged before it is compared with its floor
    mean_time: float = 60.0
    # of the bootstrap of a ratio of held-out errors
    draws: int = 2000
    seed: int = 0
