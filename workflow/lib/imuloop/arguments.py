"""What `imuloop.calibrate` and `imuloop.read` are given, checked before anything is read."""

from collections.abc import Mapping
from dataclasses import fields
from numbers import Real
from pathlib import Path

import numpy as np
import pandas as pd

from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.errors import ImuloopError, nearest
from imuloop.core.gravity import HEIGHTS, LATITUDES, STRONGEST, WEAKEST, normal_gravity
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.ingest.formats import PAIR
from imuloop.ingest.spellings import UNITS
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.settings import SegmentSettings

STAGES = {
    "segment": SegmentSettings,
    "noise": NoiseSettings,
    "calibrate": CalibrateSettings,
    "diagnose": DiagnoseSettings,
}


def gravity_of(gravity):
    """Return local gravity, m/s^2, of a number or of ``{"latitude": …, "height": …}``."""
    if isinstance(gravity, Mapping):
        if {*gravity} != {"latitude", "height"}:
            raise ImuloopError(
                f"gravity: {dict(gravity)} is no place: give {{'latitude': degrees, 'height': m}}"
            )
        for name, (low, high) in (("latitude", LATITUDES), ("height", HEIGHTS)):
            if not (_is_number(gravity[name]) and low <= gravity[name] <= high):
                raise ImuloopError(
                    f"gravity: {name} {gravity[name]!r} is not a number from {low} to {high}"
                )
        return normal_gravity(gravity["latitude"], gravity["height"])
    if not _is_number(gravity):
        raise ImuloopError(
            f"gravity: {gravity!r} is not a number, m/s^2; for a place give "
            "{'latitude': degrees, 'height': m}"
        )
    if not WEAKEST <= gravity <= STRONGEST:
        raise ImuloopError(
            f"gravity: {gravity:g} m/s^2 is no local gravity, {WEAKEST:g} to {STRONGEST:g}; of a "
            "place it is computed from latitude and height"
        )
    return float(gravity)


def _is_number(value):
    return isinstance(value, Real) and not isinstance(value, bool)


def check_settings(settings):
    """Raise an ImuloopError for a stage or a setting that there is not."""
    for stage, given in settings.items():
        if stage not in STAGES:
            raise ImuloopError(f"settings: '{stage}' is not a stage{nearest(stage, STAGES)}")
        known = [field.name for field in fields(STAGES[stage])]
        for name in given:
            if name not in known:
                raise ImuloopError(
                    f"settings.{stage}: '{name}' is not a setting{nearest(name, known)}"
                )


def check_declared(given, known):
    """Raise an ImuloopError for what cannot be declared of a log, `known` what can be."""
    for name in given:
        if name not in known:
            raise ImuloopError(f"'{name}' cannot be declared of a log{nearest(name, known)}")
    for name in ("units", "nominal"):
        quantities = UNITS if name == "units" else PAIR
        for quantity in given.get(name) or ():
            if quantity not in quantities:
                raise ImuloopError(
                    f"{name}: '{quantity}' is not a quantity{nearest(quantity, quantities)}"
                )
    for quantity, counts in (given.get("nominal") or {}).items():
        for name in counts:
            if name not in ("scale", "offset"):
                raise ImuloopError(f"nominal.{quantity}: '{name}' is neither scale nor offset")
    rate = given.get("rate")
    if rate is not None and not (isinstance(rate, Real) and 0 < rate < np.inf):
        raise ImuloopError(f"rate: {rate!r} is not a number of samples per second above 0")


def check_log(log):
    """Raise an ImuloopError for a log of a shape that nothing can be read from."""
    if isinstance(log, tuple) and (len(log) not in (3, 4) or isinstance(log[0], (str, Path))):
        raise ImuloopError(
            f"a log: a tuple of {len(log)}; it is (t, acceleration, angular_rate[, temperature]) "
            "of arrays; of two files {'acceleration': path, 'angular_rate': path}"
        )
    if isinstance(log, Mapping):
        parts = [k for k, v in log.items() if isinstance(v, (str, Path, pd.DataFrame, Mapping))]
        if parts and {*log} != {*PAIR}:
            raise ImuloopError(
                f"a log: a table or file each under {', '.join(map(str, log))}; name them "
                f"{' and '.join(PAIR)}"
            )
    if isinstance(log, (str, Path)) and not Path(log).exists():
        raise ImuloopError(f"{log}: there is no such file")


def table_of(log, columns):
    """Return a log of arrays as a table, its columns given: t, three of each sensor, temperature.

    Raises an ImuloopError for an array of another shape.
    """
    stamps, three, temperature = columns
    t, force, turn, *more = (np.asarray(x) for x in log if x is not None)
    found = {stamps: t}
    for names, values in zip(three, (force, turn), strict=True):
        if values.shape != (len(t), 3):
            raise ImuloopError(
                f"{' '.join(names)}: an array of shape {values.shape}; as many rows as t has, "
                f"({len(t)}, 3), are needed"
            )
        found |= dict(zip(names, values.T, strict=True))
    for values in more:
        if values.shape != (len(t),):
            raise ImuloopError(
                f"{temperature}: an array of shape {values.shape}; as many as t has, ({len(t)},), "
                "are needed"
            )
        found[temperature] = values
    return pd.DataFrame(found)
