"""Injections of a wrong unit, scale or frame, which gravity and turns show."""

from functools import partial

import numpy as np

from imuloop.core.units import DEGREE

# isort: off
# fmt: off
from ingest.harm import (
    about_x, added, after, distorted, gravity_as_rate, in_counts, rounded, scaled, stamps, summed,
    turned, twice,
)
# fmt: on
# isort: on
from ingest.injection import (
    COUNTS,
    GOOD,
    GRAVITY,
    IN_DEGREES,
    INCREMENTS,
    MIRRORED,
    SCALES,
    STATIC,
    SWAPPED,
    TWICE,
    Injection,
    counts,
    sensors,
    unit,
)
from ingest.logs import (
    ALL,
    FORCE,
    RATE,
    flight,
    poses,
    simulated,
    swinging,
    tilting,
)  # fmt: skip

# what is taken in a wrong unit, scale or frame; gravity and turns show it
UNITS = [
    *[Injection(f"force × {factor:.4g} taken as {name}", "brief", scaled(FORCE, factor),
                (text,), rejected, declared=unit(name))
      for name, factor, rejected, text in [
        ("m/s^2", 1 / 9.80665, True, "gravity 9.818: taken as m/s^2, it looks like g"),
        ("g", 1, True, "taken as g, it looks like m/s^2"),
        ("m/s^2", 2, True, "full scale was 0.5 times the one that the logger has"),
        ("m/s^2", 1 / 4, True, "full scale was 4 times the one"),
        ("m/s^2", 400, False, "see units.acceleration"),
        ("m/s^2", 1.4, False, "see units.acceleration")]],
    *[Injection(f"a scale error of the force of {f - 1:+.0%}, {log}", log, scaled(FORCE, f))
      for f in (0.85, 1.15) for log in ("brief", "rest")],
    Injection("force / 20 in all attitudes", "poses", scaled(FORCE, 1 / 20),
              ("gravity is in it, in 9 attitudes, 0.05",)),
    # of the rate: shown by turns alone; at rest, a bias in the wrong unit is as good as another
    *[Injection(f"rate: {text}", "poses", scaled(names, factor), (text,), True, declared=declared)
      for names, factor, declared, text in [
        (RATE, 1.0, IN_DEGREES, "taken as deg/s, it looks like rad/s"),
        (RATE, 1 / DEGREE, {}, "taken as rad/s, it looks like deg/s"),
        (RATE, 1 / 4, {}, "full scale was 4 times the one that the logger has"),
        ("t", 2, {}, "or the log's rate is off by as much"),
        (RATE, 1e3, counts(2e-3), "0.5 times the one that nominal.angular_rate.scale or range."),
        (RATE, 1e3, counts(1e-3 / DEGREE),
         "nominal.angular_rate.scale is in SI per count, and looks like deg/s")]],
    Injection("a rate that is 14 % too large", "poses", scaled(RATE, 1.14),
              ("times as far as gravity turns in its axes, over 8 moves",)),
    Injection("a rate that is 8 % too large", "poses", scaled(RATE, 1.08)),
    *[Injection(f"counts taken as {name}", log, in_counts(SCALES), None, rejected=True,
                declared={"units": {"acceleration": name}}, figures={
                "reasons": lambda lines: "declare units.acceleration: count" in str(lines)})
      for name, log in (("m/s^2", partial(simulated, "static", duration_s=60.0)),
                        ("g", partial(simulated, "multi_position", poses=6)))],
    Injection("counts that are declared", "poses", in_counts(SCALES), declared={
              "units": COUNTS, "nominal": {"acceleration": {"scale": SCALES[0]},
                                           "angular_rate": {"scale": SCALES[5]}}}),
    # increments of velocity and angle
    *[Injection(f"increments taken as {units}, in {found}", partial(log, 50.0), summed(50.0, *by),
                (f"off by the step of 0.02 s, so the log looks like {INCREMENTS.format(*found)}",),
                rejected=True, declared=sensors(*units), figures={"misdeclared": True})
      for log, units, by, found in [
        (poses, ("m/s^2", "rad/s"), (1, 1), ("m/s", "rad")),
        (swinging, ("m/s^2", "rad/s"), (1, 1 / DEGREE), ("m/s", "deg")),
        (swinging, ("m/s^2", "rad/s"), (1e3, 1e3), ("mm/s", "mrad")),
        (poses, ("g", "deg/s"), (1, 1), ("m/s", "rad"))]],
    Injection("increments that are declared", partial(swinging, 200.0), summed(200.0), None,
              declared=sensors("m/s", "rad")),
    Injection("increments in counts", "poses", after(summed(100.0, 1e7, 1e9), rounded(ALL, 1)),
              None, rejected=True, declared=sensors(*COUNTS.values()) | {"nominal":
              {"acceleration": {"scale": 1e-7}, "angular_rate": {"scale": 1e-9}}},
              figures={"reasons.0": lambda line: line.endswith("nominal.acceleration.scale: 1e-05 "
                       "and nominal.angular_rate.scale: 1e-07")}),
    Injection("increments at rest", "rest", summed(100.0), ("hold increments per sample?",)),
    Injection("g and deg/s at 1 kHz, where increments look the same", lambda: poses(1000.0),
              says=("taken as g, it looks like m/s^2", "taken as deg/s, it looks like rad/s"),
              rejected=True, declared=sensors("g", "deg/s")),
    # axes
    *[Injection(f"axes of force {force}, of rate {rate}", "poses", turned(force, rate), (text,))
      for force, rate, text in [
        (GOOD, SWAPPED, f"x as gy, y as gx, z as gz: {MIRRORED}"),
        (GOOD, (1, -2, 3), f"y as -gy, z as gz: {MIRRORED}"),
        ((1, 2, -3), GOOD, "x as -gx, y as -gy, z as gz: turned axes;"),
        (SWAPPED, SWAPPED, f"x as -gx, y as -gy, z as -gz: {MIRRORED}"),
        (GOOD, (1, 3, -2), "x as gx, y as -gz, z as gy: turned")]],
    *[Injection(f"axes {axes} behind bias, scale errors and a narrow range, seed {seed}", "poses",
                after(distorted(seed), turned(GOOD, axes)), None, drops=None,
                figures={"faults.axes.mapping": found})
      for seed in (0, 1) for axes, found in ((GOOD, None), ((1, -3, 2), [1, 3, -2]))],
    # what is never turned may be swapped or not: nobody can tell
    Injection("turns about x alone, y and z swapped", about_x, turned(GOOD, (1, 3, -2))),
    Injection("turns about x alone, x and y swapped", about_x, turned(GOOD, (2, -1, 3)),
              (f"with x as -gy: {MIRRORED}",)),
    # columns and rows that are not what they are taken for
    *[Injection(f"gravity as the rate, {size} {digits} {log}", log, gravity_as_rate(size, digits),
                (GRAVITY,), rejected=True)
      for size, digits, log in ((1, 5, "brief"), (-9.80665, 3, "poses"))],
    *[Injection(f"a turn of {w} rad/s about the vertical", "brief", added(None, "gz", w), None)
      for w in (1.1, 5.0)],
    *[Injection(f"each row again with factors {factors}", "brief", after(added(None, RATE, 0.1),
                twice(*factors, order)), (f"{TWICE}the {sensor} in",), rejected=True)
      for *factors, order, sensor in ((1 / 9.80665, 1, 1, "accelerometer"),
                                      (1, 1 / DEGREE, -1, "gyroscope"))],
    # motion
    *[Injection(f"{name}, which is not static", log, says=(said,), rejected=True, declared=STATIC)
      for name, log, said in [
        ("poses", lambda: poses(), "in 9 attitudes; a static session lies still"),
        ("a flight", flight, "changes by 31 deg/s from half a second to the next"),
        ("a slow tilt", lambda: tilting(30.0), "gravity turns by up to ")]],
    *[Injection(f"Unix time in {name}, declared as s", "brief",
                stamps(lambda t, ticks=ticks: np.rint((t + 1.7e9) * ticks).astype("int64")),
                (f"in {name} it is 2023-11-14", f"units.time is s, the log says {name}"),
                declared={"units": {"time": "s"}}, rejected=True)
      for name, ticks in (("ms", 1e3), ("ns", 1e9))],
    *[Injection(f"stamps in ms taken as s, {log}", log, scaled("t", 1e3, part), (text,), True)
      for log, part, text in (("rest", 0, "the stamps look like milliseconds: they are whole"),
                            ("poses", 0.1, "the gyroscope are 1,000 times those of gravity"))],
    *[Injection(f"stamps in {name} taken as s", "rest", scaled("t", ticks),
                (f"the stamps look like {name}; declare units.time: {name}",), rejected=True)
      for name, ticks in (("us", 1e6), ("ns", 1e9))],
    *[Injection(f"stamps {step} s apart", "brief", stamps(lambda t, s=step: np.arange(len(t)) * s),
                ("Hz is no rate of an IMU",), rejected=True) for step in (5e-324, 1e-12, 1e100)],
]  # fmt: skip
