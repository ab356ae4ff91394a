"""Injections of values that one sensor writes wrongly; every sample is kept."""

import numpy as np

from imuloop.core.samples import TEMPERATURE

# isort: off
# fmt: off
from ingest.harm import (
    added, after, at, changed_amid, clipped, clipped_share, every, fading, flat_top, held, later,
    nothing, put, reached, rounded, scaled, sixteen_bits, spikes, turned_in_a_gap, wrapped,
)
# fmt: on
# isort: on
from ingest.injection import (
    LOGS,
    NO_FAULT_OF_VALUES,
    STATIC,
    Injection,
    both,
    counts,
)
from ingest.logs import (
    ALL,
    FORCE,
    RATE,
    between_two_levels,
    brief,
    drifting_with_temperature,
    gait,
    rest,
    turning_at_once,
)  # fmt: skip

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
