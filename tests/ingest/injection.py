"""An injection: how a sound log is harmed, and what ingest must say and do then.

A row holds, in this order: what is wrong with the log, in words; the sound log that it is put into
(`LOGS`); the function that puts it there; the text of each line that ingest then says, in the order
of quality.json, reasons before warnings. Then, by name,

- ``rejected``: whether the session is, or else it is "ok";
- ``drops``: labels of the rows that are dropped, None where that is left to chance; all others
  come back with each value they had, those that were written twice once;
- ``rebuilt_within``: stamps come back as they were before the harm, to so many seconds;
- ``figures``: figures of quality.json by path, each a value or a function that must hold of it;
- ``declared``: what the user declares of the log.
"""

from dataclasses import dataclass, field

import pytest

from imuloop.core.units import DEGREE

# isort: off
# fmt: off
from ingest.harm import (
    nothing,
)
# fmt: on
# isort: on
from ingest.logs import (
    brief,
    poses,
    rest,
    swaying,
)  # fmt: skip

LOGS = {"poses": poses, "rest": rest, "brief": brief, "swaying": swaying}
STATIC = {"kind": "static"}


@dataclass(frozen=True)
class Injection:
    name: str
    log: object
    harm: object = nothing()
    says: tuple = ()
    rejected: bool = False
    drops: tuple | None = ()
    rebuilt_within: float | None = None
    figures: dict = field(default_factory=dict)
    declared: dict = field(default_factory=dict)


def check_figures(quality, figures):
    """Check figures by their paths, as "gaps.list.0.start_s": what they are, or what holds."""
    for path, expected in figures.items():
        value = quality
        for key in path.split("."):
            value = value[int(key) if key.isdigit() else key]
        if callable(expected):
            assert expected(value), (path, value)
        else:
            near = pytest.approx(expected) if isinstance(expected, float) else expected
            assert value == near, path


def injected(case):
    """Return the harmed log of a row, its rows labelled as in the sound one."""
    return case.harm(LOGS.get(case.log, case.log)())


# --- the table

GOOD, SWAPPED = (1, 2, 3), (2, 1, 3)
MIRRORED = "swapped or mirrored axes"
BURSTS = "in bursts (median step 2 ms, mean 9.97 ms)"
SCATTER = "scatter about a regular clock"
PACKETS = "as of packets of samples: t is rebuilt from the row number"
REBUILT, NOT_REBUILT = {"clock.rebuilt": True}, {"clock.rebuilt": False}
NS, US = {"units": {"time": "ns"}}, {"units": {"time": "us"}}
IN_DEGREES = {"units": {"angular_rate": "deg/s"}}
COUNTS = dict.fromkeys(("acceleration", "angular_rate"), "count")
SCALES = [9.80665 / 16384] * 3 + [DEGREE / 131] * 3
GRAVITY = "hold gravity: vectors of constant length along the acceleration"
INCREMENTS = ("increments of velocity and angle per sample; declare units.acceleration: {} and "
              "units.angular_rate: {}")  # fmt: skip
TWICE = "500 rows repeat the one before, with its time stamp, in another unit: "
NO_FAULT_OF_VALUES = {
    "faults.stuck": lambda found: not any(f["stretches"] for f in found.values()),
    "faults.clipped_at": lambda found: not any(f["rows"] for f in found.values()),
    "faults.rows_a_value": {"acceleration": 1, "angular_rate": 1},
    "faults.copies": [],
    "faults.silent_at_rest": [],
}


def counts(scale):
    return {"units": {"angular_rate": "count"}, "nominal": {"angular_rate": {"scale": scale}}}


def unit(name):
    return {"units": {"acceleration": name}, "gravity": 9.818}


def sensors(*units):
    return {"units": dict(zip(COUNTS, units, strict=True))}


def both(name, harm, says, at_rest=None, **more):
    """Rows of one harm to a log at rest and to one of poses; at rest another line may be said."""
    return [
        Injection(f"{name}, at rest", "rest", harm, (at_rest or says,), **more),
        Injection(f"{name}, in poses", "poses", harm, (says,), **more),
    ]
