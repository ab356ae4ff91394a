"""The table of injections: how a sound log is harmed, and what ingest must say and do then.

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
from functools import partial

import numpy as np
import pandas as pd
import pytest

from imuloop.core.samples import TEMPERATURE
from imuloop.core.units import DEGREE

# isort: off
# fmt: off
from ingest.harm import (
    about_x, added, after, at, changed_amid, clipped, clipped_share, counter,
    distorted, every, fading, flat_top, gravity_as_rate, held, held_back, in_bursts, in_counts,
    in_packets, late, later, lost, nothing, on_grid, put, reached, rounded,
    sampled_unevenly, scaled, scattered, sixteen_bits, spikes, stamps, summed,
    turned, turned_in_a_gap, twice, unpadded, wrapped, written_twice,
)
# fmt: on
# isort: on
from ingest.logs import (
    ALL,
    FORCE,
    RATE,
    between_two_levels,
    brief,
    drifting_with_temperature,
    flight,
    gait,
    poses,
    rest,
    simulated,
    swaying,
    swinging,
    tilting,
    turning_at_once,
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


# what one sensor writes wrongly: named, and every sample kept
VALUES = [
    *both("zeros on all axes for 2 s", put(ALL, 0.0, 0.4, 200),
          "zero on all axes: acceleration in 200 rows, angular_rate in 200"),
    *both("zeros of the force", put(FORCE, 0.0, 0.6, 30), "axes: acceleration in 30 rows;"),
    *both("zeros of the rate", put(RATE, 0.0, 0.6, 300), "stuck at one value: gx 300 samples"),
    *both("one axis stuck for 5 s", put(["ay"], None, 0.3, 500),
          "stuck at one value: ay 500 samples,"),
    *both("one axis at zero", put(["gz"], 0.0, 0.3, 120), "stuck at one value: gz 1"),
    *both("spikes on all channels", spikes(-300.0),
          "spikes of a single sample: ax 3, ay 3, az 3, gx 3, gy 3, gz 3;"),
    *both("clipped above", clipped_share("ax", 0.93), "at a repeated extreme value: ax "),
    *both("both sensors at half the rate", held(ALL, 2), "held: acceleration for 2 rows,"),
    *both("the force at no whole share", held(FORCE, 2.5), "held: acceleration for 2.5 rows"),
    *both("an axis as one of the other sensor", lambda log: log.assign(gx=log.ax),
          "gx is a copy of ax: see col"),
    *both("a dead zone", lambda log: log.assign(**log[RATE].where(log[RATE].abs() > 0.04, 0.0)),
          "no noise at rest: gx, gy, gz;", "never changing: gx, gy, gz"),
    *both("a temperature in K", scaled(TEMPERATURE, 1, 273.15), "counts, failed reads, or in K"),
    *both("a temperature that never changes", put([TEMPERATURE], 21.0), "is 21 degC throughout"),
    *both("a force a hundred times too small", scaled(FORCE, 0.01), "gravity is in it, in 9 ",
          "has gravity been taken out"),
    *both("a rate that no hand makes", scaled(RATE, 1e4), "too much for a turn by hand"),
    *both("a gap", later((2000, 0.7)), "1 gap, 0.71 s together"),
    *both("a gap of an hour", later((2000, 3600)), "1 gap, 3600 s together"),
    *[Injection(f"nothing at all, {log}", log) for log in LOGS],
    Injection("a force that never changes", "rest", put(FORCE, 0.5),
              ("the acceleration never changes", "never changing: ax, ay, az",
               "has gravity been taken out"), rejected=True),
    Injection("turns that are clipped", "poses", clipped(RATE, -0.5, 0.5), ("clipped at",),
              figures={"faults.failed_reads": lambda found: not any(found.values())}),
    *[Injection(f"{name} clipped, in values without steps", "poses", after(fading(names),
                clipped(names, -end, end)), None, drops=None,
                figures={f"faults.clipped_at.{name}.rows": lambda rows: rows > 100})
      for name, names, end in (("gx", RATE, 0.5), ("az", FORCE, 9.0))],
    Injection("turns that are clipped, one of them for 1.5 s at one end", "poses",
              after(clipped(RATE, -0.5, 0.5), clipped(["gy"], -0.5, 0.45),
              put(["gy"], 0.5, 0.5, 150)), None,
              drops=None, figures={"faults.stuck.gy.rows": 0,
                                   "faults.clipped_at.gy.values": [-0.5, 0.5]}),
    *[Injection(f"a flat top of {rows} rows, values held for {count}", "poses",
                flat_top(rows, count), None, figures={"faults.clipped_at.gx.rows": found})
      for rows, count, found in ((5, 1, 5), (1, 1, 0), (5, 3, 0))],
    # too few on any axis alone: fast turns reach the end of a range at their peaks only
    Injection("an end of the range that each axis reaches for 9 rows", "poses", reached(5.0, 9),
              None, drops=None,
              figures={"rails": {"gx": [None, 5.0], "gy": [-5.0, None], "gz": [None, 5.0]}}),
    *[Injection(f"the end of sixteen bits, zero at {zero}", "poses", sixteen_bits(zero),
                ("clipped at a repeated extreme value: gx 18 samples",), declared=counts(1e-4) |
                {"nominal": {"angular_rate": {"scale": 1e-4, "offset": zero}}})
      for zero in (0, 32768)],
    Injection("a gyroscope of coarse steps", "poses", rounded(RATE, 0.2), ("no noise at rest",)),
    Injection("noise far below the step", between_two_levels, says=None, declared=STATIC,
              figures=NO_FAULT_OF_VALUES),
    Injection("a walk, which never rests", gait, says=(),
              figures={"faults.rests.share": lambda share: share < 0.1}),
    Injection("turns that begin at once, which wrap around no integer", turning_at_once, says=None,
              figures={"faults.wraps": dict.fromkeys(ALL, 0)}),
    Injection("a bias that drifts with temperature", lambda: drifting_with_temperature(1),
              declared=STATIC),
    *[Injection(f"a {what} that changes amid the log", "rest", changed_amid(*by),
                ("scale or bias changed amid the log",),
                figures={"faults.rests.jump_s": lambda s: abs(s - 35) < 8})
      for what, by in (("scale", (0.5, 0.0)), ("bias", (1.0, 5.0)))],
    # failed reads: such rows would pass for clipped ones, or padding
    *[Injection(f"failed reads: {said}", "poses", every(*what), (said,), rejected=True)
      for *what, said in [
        (2, ["gy", "gz"], 32767 * 0.001, "gy, gz: 50% of rows hold"),
        (2, FORCE, 0.0, "ax, ay, az: 50% of rows hold"),
        (3, RATE, 0.0, "gx, gy, gz: 33% of rows hold")]],
    *[Injection(f"an integer that wraps around {n} times, units wrong", "poses", wrapped(n), None,
                rejected=True, figures={"faults.wraps.gx": lambda found, n=n: found >= n,
                "reasons.0": lambda line, said=said: said in line})
      for n, said in ((3, "m/s^2, it looks like g"), (21, "an integer that wraps around"))],
    Injection("a turn while nothing is logged", "poses", turned_in_a_gap(),
              ("1 gap", "was turned while nothing was logged"),
              figures={"faults.rests.gap_s": lambda s: s > 1}),
    # rows that cannot be used: dropped and counted
    Injection("spikes", lambda: rest()[:2000], after(*(added([row], name, 3.0) for row, name in
              ((99, "ay"), (299, "gz"), (1234, "gz"), (1400, "gx")))),
              ("rows dropped for a spike that no body makes: ay 1, gx 1, gz 2",),
              drops=(99, 299, 1234, 1400), figures={"spiked": 4, "gaps.count": 0,
              "faults.spikes": lambda found: not any(found.values())}),
    Injection("a spike in each 15th row", "rest", added(range(50, 6950, 15), "gx", 1.0),
              ("with a spike (gx ", "rows dropped", "spikes of a single sample"), rejected=True),
    *[Injection(f"a value that no sensor gives, {name} {size}", "brief", at([100, 250], name, size),
                ("2 gaps", f"beyond ± 1e+10 in SI, which no sensor gives: {name} 2;"),
                drops=(100, 250), figures={"non_finite": 2, f"impossible_values.{name}": 2,
                                           f"missing_values.{name}": 0})
      for name, size in (("ax", 1e12), ("gy", 1e306))],
    Injection("as many values missing as may be", "brief", at(range(25), "gz", np.nan),
              drops=range(25), figures={"non_finite": 25}),
    Injection("one value more missing", "brief", at(range(26), "gz", np.nan),
              ("26 of 500 rows (5.2%) cannot be used",), rejected=True, figures={"non_finite": 26}),
    *[Injection(f"changes that no sensor resolves: {names}", "brief", scaled(names, 1e-200),
                ("in the whole log, which no sensor resolves", *more), rejected=True)
      for names, more in ((FORCE, ("has gravity been taken out",)), (["gz"], ()))],
    Injection("temperatures that are missing", "brief",
              lambda log: log.assign(temperature=np.where(log.index % 10, np.nan, 25.0)),
              ("450 temperatures are missing",),
              figures={"missing_values.temperature": 450, "constant": ["temperature"],
                       "temperature_range": [25.0, 25.0]}),
    Injection("samples at the end of the full scale", "brief",
              at(range(5, 9), "ax", [16.0, -15.9, 15.68, 15.6]),
              ("samples at the end of the full scale: ax 3; rests, turns and moves with them",),
              declared={"full_scale": {"acceleration": 16.0}}, figures={"clipped.ax": 3,
              "clipped.ay": 0, "clipped.gx": None, "rails": {"ax": [-15.68, 15.68]}}),
    Injection("too few rows", "brief", lambda log: log[:99],
              ("99 usable rows, at least 100 needed",), rejected=True),
    Injection("too short", "brief", lambda log: log[:150],
              ("the log lasts 1.49 s, at least 2 s needed.",), rejected=True),
    Injection("seconds that are declared as ms", "brief", nothing(), ("the log lasts 0.00499 s, at "
              "least 2 s needed: the stamps look like s or min; declare units.time: s",),
              rejected=True, declared={"units": {"time": "ms"}}),
    Injection("few blocks of white noise", lambda: brief(1100), scaled("t", 100 / 350),
              declared=STATIC),
    Injection("steps of the gyroscope and a gap", "brief", after(rounded(["gx"], 0.00106),
              later((100, 0.5))), None, figures={"duration_s": 5.49, "rate_hz": 100.0,
              "mean_specific_force": lambda f: abs(f - 9.8025) < 2e-3,
              "quantisation_step.gx": 0.00106}),
]  # fmt: skip

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

# stamps and clocks
CLOCKS = [
    Injection("32 bits of us roll over", "brief", counter(2**32, 1e-6),
              ("the stamps roll over after 4294.967296 s, once: the span is added",),
              rebuilt_within=1e-12, declared=US, figures={"gaps.count": 0, "clock.rollovers": 1}),
    Injection("24 bits of us roll over in a gap", "brief", counter(2**24, 1e-6, gap=3),
              ("the stamps roll over after 16.777216 s", "1 gap"), rebuilt_within=1e-12,
              declared=US, figures={"clock.rollovers": 1}),
    Injection("the ms of a week begin again", "brief", counter(604_800_000, 1e-3),
              ("the stamps roll over after 604800 s",), rebuilt_within=1e-12,
              declared={"units": {"time": "ms"}}, figures={"clock.rollovers": 1}),
    Injection("a time of the day at midnight", "brief", stamps(lambda t: pd.to_datetime(
              (np.rint(t * 1000) + 86_397_000) % 86_400_000, unit="ms").strftime("%H:%M:%S.%f")),
              ("the stamps roll over after 86400 s",), rebuilt_within=1e-9),
    # goes on ten usual steps after the last stamp
    Injection("the clock starts again", "brief", stamps(lambda t: np.r_[100 + t[:200], t[:300]]),
              ("the stamps start again once", "1 gap, 0.1 s together"),
              figures={"clock.resets": 1, "gaps.list.0.start_s": 1.99, "gaps.total_s": 0.1}),
    Injection("the clock starts again early on, and again", "brief",
              stamps(lambda t: np.r_[1e3 + t[:30], 0.0123 + t[:235], 0.0123 + t[:235]]),
              ("the stamps start again 2 times", "2 gaps, 0.2 s together"),
              figures={"clock.resets": 2}),
    Injection("a clock that rolls over, starts again, strays and lacks stamps", "brief",
              after(counter(2**32, 1e-6, 100),
                    stamps(lambda t: np.r_[t[:330], t[330:] - t[330] + 77]),
                    at([20, 250], "t", 1e12), at([50, 51, 210, 400], "t", np.nan)),
              None, drops=(20, 50, 51, 210, 250, 400), declared=US,
              figures={"clock.rollovers": 1, "clock.resets": 1, "clock.strays": 2}),
    *[Injection(f"{block} rows written later", "brief", late(block), ("1 gap",),
                drops=range(100, 100 + block), rebuilt_within=1e-12,
                figures={"clock.resets": 0, "clock.rollovers": 0, "clock.strays": 0,
                         "out_of_order": block}) for block in (1, 20)],
    Injection("stamps far ahead", "brief", at([0, 70], "t", 1e9),
              ("2 stamps lie ahead of rows that follow in their place", "1 gap"),
              drops=(0, 70), figures={"non_finite": 2, "clock.strays": 2}),
    *[Injection(f"a stamp of {value} in row {row} stands for none", "brief",
                after(scaled("t", 1e9), lambda log: log.astype({"t": "int64"}),
                      at([row], "t", value)), None, drops=(row,), rebuilt_within=2e-9,
                declared=NS, figures={"non_finite": 1, "gaps.count": row > 0})
      for value in (-(2**63), 2**63 - 1) for row in (0, 250)],
    Injection("a stamp repeated, one late, one missing", "brief", at([10, 20, 30], "t",
              [0.09, 0.15, np.nan]), None, drops=(10, 20, 30), rebuilt_within=1e-12,
              figures={"duplicates": 1, "out_of_order": 1, "non_finite": 1}),
    Injection("stamps that never change", "brief", stamps(np.zeros_like),
              ("499 with a repeated stamp, see columns.time", "1 usable rows"), rejected=True),
    Injection("gaps of half a second and of one row", "brief", later((100, 0.5), (300, 0.01)),
              ("2 gaps, 0.53 s together",),
              figures={"rate_hz": 100, "gaps.total_s": 0.53, "gaps.list.0.start_s": 0.99,
                       "gaps.list.0.duration_s": 0.51, "gaps.list.1.duration_s": 0.02}),
    Injection("a rate that is declared 100 ppm off", "brief", nothing(), declared={"rate": 100.01},
              figures={"clock.drift_ppm": -99.99, "clock.jitter_ppm": lambda ppm: ppm < 1e-3}),
    Injection("stamps that jitter by a tenth of a step", "brief",
              stamps(lambda t: t + np.tile([0, 1e-3], len(t) // 2)), None,
              figures={"clock.drift_ppm": None,
                       "clock.jitter_ppm": lambda ppm: abs(ppm - 1e5) < 1e3}),
    Injection("a counter of days", "brief", stamps(lambda t: t + 400 * 86400)),
    *[Injection(f"{rows} rows that are held back at random", partial(brief, rows), held_back(),
                None, rejected, figures=NOT_REBUILT | {"misdeclared": rejected, where: lambda lines:
                "lie on no line" in str(lines) and "columns.time: null, and about" in str(lines)})
      for rows, rejected, where in ((20_000, False, "warnings"), (60_000, True, "reasons"))],
    # of bursts 99 pauses are logged, and rows that are dropped keep their place
    Injection("samples in bursts, two missing", "brief",
              after(in_bursts(), at([7, 300], "ax", np.nan)), (BURSTS, "2 gaps"), drops=(7, 300),
              rebuilt_within=5e-3, figures=REBUILT | {"gaps.count": 2, "jitter.max_s":
              lambda s: s < 1e-8, "clock.logged.gaps.count": 100}),
    Injection("bursts of a log that does not end with one", "brief",
              after(lambda _: brief(13_374), in_bursts(spacing=2e-5)), ("in bursts",),
              declared={"rate": 100}, rebuilt_within=5e-3,
              figures=REBUILT | {"rate_hz": lambda hz: abs(hz - 100) < 1e-3}),
    Injection("bursts of a sensor that pauses", "brief", after(in_bursts(), later((250, 3))), None,
              figures=NOT_REBUILT | {"clock.logged": None}),
    Injection("bursts of a sensor that is declared to pause", "brief", in_bursts(), None,
              declared={"rate": 500}, figures=NOT_REBUILT),
    # of the widest a few run far ahead and are missing
    *[Injection(f"stamps that scatter by {std} s", "swaying", scattered(std), (SCATTER, *more),
                drops=drops, rebuilt_within=None if more else 9e-4,
                figures=REBUILT | {"out_of_order": 0, "rate_hz": lambda hz: abs(hz - 100) < 1e-3})
      for std, more, drops in ((5e-4, (), ()), (2e-3, (), ()),
                               (5e-3, ("25 stamps lie ahead of rows", "25 gaps"), None))],
    Injection("stamps that scatter, one sample lost", "swaying",
              after(scattered(0.002, 13), lambda log: log.drop(index=[9000])),
              (SCATTER, "1 gap, 0.02 s"), drops=None,
              figures=REBUILT | {"gaps.list.0.start_s": lambda s: abs(s - 89.99) < 0.05}),
    Injection("a sensor that is sampled unevenly", "swaying", sampled_unevenly(), None, drops=None,
              figures=NOT_REBUILT),
    *[Injection(f"stamps of {rate} Hz on a grid of {grid} s", "poses", on_grid(rate, grid),
                ("scatter about a regular clock, no sample is lost",), drops=None,
                figures={"rate_hz": lambda hz, rate=rate: abs(hz / rate - 1) < 1e-4,
                         "gaps.count": 0, "clock.jitter_ppm": lambda ppm: ppm < 1})
      for rate, grid in ((90.0, 0.01), (62.5, 0.01), (26.0, 0.02))],
    *[Injection(f"samples lost, {name}", "poses", harm, None, drops=None, figures=NOT_REBUILT |
                {"rate_hz": lambda hz: abs(hz - 100) < 1e-3})
      for name, harm in (("each tenth", lambda log: log[log.index % 10 > 0]),
                         ("a fifth at random", lost(0.2)))],
    # in moves too; that must not hide the scale that turns show
    Injection("one sample in thirty lost", "poses", lost(0.03), ("gaps",),
              figures={"faults.rests.turn_ratio.moves": lambda moves: moves >= 7}),
    *[Injection(f"packets of {size}, a share of {share} with the stamp of their {end} row, "
                f"rate {rate}", "poses", in_packets(size, share, jitter, end == "last"), (PACKETS,),
                rebuilt_within=0.1, declared={"rate": rate} if rate else {},
                figures={"gaps.count": 0, "duplicates": 0,
                         "rate_hz": lambda hz: abs(hz / 100 - 1) < 1e-3})
      for size, share, jitter, rate in [(5, 0.2, 2e-3, None), (8, 1.0, 0.0, None),
                                        (3, 0.6, 1e-4, 100), (2, 0.005, 1e-4, None)]
      for end in ("last", "first")],
    *[Injection(f"rows from {first} on written twice, each of {each}", "poses",
                written_twice(first, each), ("rows identical to the one before",),
                figures={"duplicates": 0, "identical": lambda n: n > 1000, "gaps.count": 0})
      for first, each in ((0, 3), (1, 2))],
    Injection("a repeated stamp with other values", "poses", at([500, 501], "t", 4.99), None,
              drops=(500, 501), figures={"identical": 0, "duplicates": 2}),
    *[Injection(f"parts of a second without leading zeros, {rate} Hz", "poses",
                unpadded(rate, first, digits), (said,), rejected=True)
      for rate, first, digits, said in [
        (40.0, 0.007, 9, "parts of a second were joined without leading zeros"),
        (125.0, 0.0004, 9, "parts of a second were joined without leading zeros"),
        (100.0, 0.0, 3, "without leading zeros (3 ms as .3)"),
        (100.0, 0.005, 3, "without leading zeros (3 ms as .3)")]],
]  # fmt: skip

INJECTIONS = [*VALUES, *UNITS, *CLOCKS]
