"""Tests of whether a log fits its declared units and full scales, by gravity.

Gravity checks both sensors without a calibration: its size is the specific force at rest, and its
direction turns in the axes of the device as the gyroscope shows. So each sensor has a `Ratio` of
its output to gravity, which is 1 in a good log. No real sensor is off by a half. A ratio that
differs from 1 is compared with the factors of all other ways to read the log (`readings`): in
another unit, with another full scale, or as increments of velocity and angle. The nearest factor
within the error of the ratio is the cause.

Each function takes the `Evidence` e on a log, and returns a false value if all is well.
"""

from dataclasses import dataclass

import numpy as np

from imuloop.core.samples import ACCELERATION
from imuloop.core.units import FACTORS, INCREMENTS
from imuloop.ingest.axes import AGREEMENT

# the specific force is plausible if it is gravity within the first factor at rest, and within the
# second factor as the mean of a log without rests
AT_REST, MOVING = 1.25, 2.0
# the scale changed if the force at rest changes by this factor: unknown biases of counts change it
# by a third from attitude to attitude
CHANGED = 1.5
# relative error of a ratio by a bias of a tenth of g or a scale error; the largest error of a ratio
# that is used, which turns inside moves have
NEAR, MOST_ERROR = 0.1, 0.15
# full scales of a sensor differ by powers of two
FULL_SCALES = (2, 4, 8, 16, 1 / 2, 1 / 4, 1 / 8, 1 / 16)


@dataclass(frozen=True)
class Ratio:
    """The ratio of a sensor's output to gravity, which is 1 in a good log.

    For the accelerometer it is the specific force over the magnitude of gravity. For the gyroscope
    it is the turns by the angular rate over the turns of gravity's direction. The ratio has a
    `value`, a relative `error`, and `words` for a message. The sensor is off if the value differs
    from 1 by more than the factor `most`.
    """

    value: float
    error: float
    most: float
    words: str

    @property
    def is_off(self):
        """Whether the value differs from 1 by more than the factor `most`, up or down."""
        return np.isfinite(self.value) and not 1 / self.most <= self.value <= self.most

    def nearest(self, factors, error=None):
        """Return the words of the factor nearest to the value, or None if it is not near enough.

        `factors` is a list of (factor, words), such as the result of `readings`. A factor is near
        enough within the relative `error`, by default the error of the ratio.
        """
        distances = [(abs(np.log(self.value / factor)), words) for factor, words in factors]
        distance, words = min(distances)
        return words if distance <= np.log(1 + (error or self.error)) else None


def force_ratio(e):
    """Return the Ratio of the specific force to gravity.

    The force is its median size at rest or, if the log has no rests, its mean size. The result is
    None without an accelerometer, or if the sampling rate was too implausible to look for faults.
    `e` is the Evidence on a log: all that ingest knows about it.
    """
    if e.absent == "acceleration" or not e.figures["faults"]:
        return None
    force, where, most = e.figures["mean_specific_force"], "mean specific force", MOVING
    if rests := e.faults["rests"]:
        force, where, most = rests["force"][1], "specific force at rest", AT_REST
    words = f"the {where} is {force:.4g} m/s^2, gravity {e.declared.gravity:.4g}"
    return Ratio(force / e.declared.gravity, NEAR, most, words)


def turn_ratio(e):
    """Return the Ratio of turns by the gyroscope to turns of gravity, None without turns.

    It comes from moves between two rests or, without these, from `fit_axes`, with a larger error.

    `e` is the Evidence on a log: all that ingest knows about it.
    """
    axes, rests = e.faults["axes"], e.faults["rests"]
    words = "the angular rate turns the device {:.3g} times as far as gravity turns in its axes"
    if turns := rests and rests["turn_ratio"]:
        value, words = turns["value"], f"{words}, over {turns['moves']} moves from rest to rest"
        # three standard errors, with a least error
        error = max(NEAR / 2, 3 * turns["std"] / value)
    elif axes and axes["ratio"] and axes["best"] > AGREEMENT:
        value, error = axes["ratio"], MOST_ERROR
    else:
        return None
    return Ratio(value, error, 1 + max(NEAR, error), words.format(value))


RATIOS = {"acceleration": force_ratio, "angular_rate": turn_ratio}


def readings(e, quantity):
    """Return the factors by which a sensor's output is off if it is read wrongly, a list.

    An item is (factor, words). The factor is the output as read over the true output. The sensor is
    read wrongly if its `quantity` is taken in another unit or at another full scale. Full scales
    are left out if the log has no rests, or a channel is constant, stuck or clipped. `e` is the
    Evidence on a log: all that ingest knows about it.
    """
    unit = e.raw_units[quantity]
    scale, where = unit.scale, f"units.{quantity}"
    if unit.name == "count":
        scale, where = 1, f"nominal.{quantity}.scale, in SI per count, or range.{quantity}"
    factors = [
        (scale / si, f"taken as {unit.name}, it looks like {name}; see {where}")
        for name, si in FACTORS[quantity].items()
        if si != scale
    ]
    if not e.is_cut and e.faults["rests"]:
        words = f"the sensor's full scale was {{:g}} times the one that is set; see {where}"
        factors += [(factor, words.format(1 / factor)) for factor in FULL_SCALES]
    return factors


def steps(e, quantity):
    """Return the factors by which a sensor is off if its increments are taken as rates, a list.

    An increment is the integral of the output over a step. An item of the list is (factor, right
    declaration), one for each unit of an increment of the sensor with this `quantity`. `e` is the
    Evidence on a log: all that ingest knows about it.
    """
    unit, is_count = e.raw_units[quantity], e.raw_units[quantity].name == "count"
    words = f"nominal.{quantity}.scale: {{1:.6g}}" if is_count else f"units.{quantity}: {{0}}"
    rates = {name: si * e.figures["rate_hz"] for name, si in INCREMENTS[quantity].items()}
    scale = 1 if is_count else unit.scale
    return [(scale / n, words.format(name, unit.scale * n)) for name, n in rates.items()]


def increments(e):
    """Return values for a message if both sensors look like increments that are taken as rates.

    The values are a dict by name. Wrong units may look the same: increments over 1 ms in mm/s and
    mrad are the same numbers as rates in m/s^2 and rad/s. If wrong units fit both sensors, they are
    taken as the cause, and the result is None, as for a good log. `e` is the Evidence on a log: all
    that ingest knows about it.
    """
    force, turns = (ratio(e) for ratio in RATIOS.values())
    if not (force and force.is_off and turns and turns.error <= MOST_ERROR):
        return None
    # the mean force of a log without rests is gravity only within a factor
    error = None if e.faults["rests"] else 0.5
    declare, units = (
        [force.nearest(of(e, "acceleration"), error), turns.nearest(of(e, "angular_rate"))]
        for of in (steps, readings)
    )
    if not all(declare) or all(units):
        return None
    words = f"{force.words}, and {turns.words}: both sensors are off by"
    return {"words": words, "step": 1 / e.figures["rate_hz"], "unit": " and ".join(declare)}


def cause(e, quantity):
    """Return words on the wrong unit, full scale or scale of counts if a sensor's output is off.

    `e` is the Evidence on a log: all that ingest knows about it. `quantity` is the quantity of the
    sensor. The result is None or false if the output is not off, or if none of these explains it.
    """
    ratio, unit = RATIOS[quantity](e), e.raw_units[quantity]
    if not (ratio and ratio.is_off and ratio.error <= MOST_ERROR):
        return None
    words = ratio.nearest(readings(e, quantity))
    levels = [(e.figures["quantisation_step"][name] or 0) / unit.scale for name in ACCELERATION]
    if not words and unit.name in ("m/s^2", "g") and np.allclose(levels, 1, 1e-6):
        scale = "" if e.declared.nominal.get(quantity) else f", and nominal.{quantity}.scale"
        words = f"whole numbers that look like counts; declare units.{quantity}: count{scale}"
        words += "; see units.angular_rate too"
    return words and f"{ratio.words}: {words}"


def size_of_force(e):
    """Return words on the size of the specific force if it is not gravity, else a false value.

    `e` is the Evidence on a log: all that ingest knows about it.
    """
    ratio = force_ratio(e)
    return ratio and ratio.is_off and ratio.words


def changed_force(e):
    """Return the least and the largest size of the specific force at rest if they differ, a dict.

    The 5 % quantile of the sizes at rest is taken as the least, and the 95 % quantile as the
    largest. They differ if the largest is more than `CHANGED` times the least. Otherwise the result
    is False. It is False, too, if the log has no rests, or if a channel is constant, stuck, clipped
    or a copy. `e` is the Evidence on a log: all that ingest knows about it.
    """
    rests, is_whole = e.faults["rests"], not (e.is_cut or e.faults["copies"])
    low, _, high = rests["force"] if rests and is_whole else (1.0, 1.0, 1.0)
    return high > CHANGED * low and {"low": low, "high": high}


def scale_of_rate(e):
    """Return words on the scale of the angular rate if it contradicts the turns of gravity.

    Otherwise the result is a false value, and also if a channel is constant, stuck or clipped. `e`
    is the Evidence on a log: all that ingest knows about it.
    """
    ratio = turn_ratio(e)
    return ratio and ratio.is_off and not e.is_cut and ratio.words
