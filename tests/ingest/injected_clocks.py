"""Injections into time stamps and clocks."""

from functools import partial

import numpy as np
import pandas as pd

# isort: off
# fmt: off
from ingest.harm import (
    after, at, counter, held_back, in_bursts, in_packets, late, later, lost, nothing, on_grid,
    sampled_unevenly, scaled, scattered, stamps, unpadded, written_twice,
)
# fmt: on
# isort: on
from ingest.injection import (
    BURSTS,
    NOT_REBUILT,
    NS,
    PACKETS,
    REBUILT,
    SCATTER,
    US,
    Injection,
)
from ingest.logs import brief

# stamps and clocks
CLOCKS = [
    # what the counter is; span, ticks, and length of a tick, s; rows lost there
    *[Injection(name, "brief", counter(width, tick, gap=gap),
                (f"the stamps roll over after {width * tick:.10g} s, once: the span is added",
                 *["1 gap"] * bool(gap)),
                rebuilt_within=1e-12, declared={"units": {"time": unit}},
                figures={"gaps.count": bool(gap), "clock.rollovers": 1})
      for name, width, tick, unit, gap in [
          ("32 bits of us roll over", 2**32, 1e-6, "us", 0),
          ("24 bits of us roll over in a gap", 2**24, 1e-6, "us", 3),
          ("the ms of a week begin again", 604_800_000, 1e-3, "ms", 0)]],
    Injection("a time of the day at midnight", "brief", stamps(lambda t: pd.to_datetime(
              (np.rint(t * 1000) + 86_397_000) % 86_400_000, unit="ms").strftime("%H:%M:%S.%f")),
              ("the stamps roll over after 86400 s",), rebuilt_within=1e-9),
    # goes on ten usual steps after the last stamp
    Injection("the clock starts again", "brief", stamps(lambda t: np.r_[100 + t[:200], t[:300]]),
              ("the stamps start again once", "1 gap, 0.1 s together"),
              figures={"clock.resets": 1, "gaps.list.0.start_s": 1.99, "gaps.total_s": 0.1}),
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
    Injection("late stamps at both ends of the log", "brief",
              after(*[later((row, -1.005), (row + 1, 1.005)) for row in (1, 499)]), None,
              drops=(1, 499), rebuilt_within=1e-12, figures={"out_of_order": 2}),
    *[Injection(f"a stamp of {value} in row {row} stands for none", "brief",
                after(scaled("t", 1e9), lambda log: log.astype({"t": "int64"}),
                      at([row], "t", value)), None, drops=(row,), rebuilt_within=2e-9,
                declared=NS, figures={"non_finite": 1, "gaps.count": row > 0})
      for value, row in ((-(2**63), 0), (2**63 - 1, 250))],
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
    *[Injection(f"{rows} rows that are held back at random", partial(brief, rows), held_back(),
                None, rejected, figures=NOT_REBUILT | {"misdeclared": rejected, where: lambda lines:
                "lie on no line" in str(lines) and "columns.time: null, and about" in str(lines)})
      for rows, rejected, where in ((20_000, False, "warnings"), (60_000, True, "reasons"))],
    # of bursts 99 pauses are logged, and rows that are dropped keep their place
    Injection("samples in bursts, two missing", "brief",
              after(in_bursts(), at([7, 300], "ax", np.nan)), (BURSTS, "2 gaps"), drops=(7, 300),
              rebuilt_within=5e-3, figures=REBUILT | {"gaps.count": 2, "jitter.max_s":
              lambda s: s < 1e-8, "clock.logged.gaps.count": 100}),
    *[Injection(f"bursts of a sensor that {how}", "brief", harm, None, declared=declared,
                figures=NOT_REBUILT | {"clock.logged": None})
      for how, harm, declared in (("pauses", after(in_bursts(), later((250, 3))), {}),
                                  ("is declared to pause", in_bursts(), {"rate": 500}))],
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
    # in moves too; that must not hide the scale that turns show
    *[Injection(f"samples lost, {name}", "poses", harm, None, drops=None, figures=NOT_REBUILT |
                {"rate_hz": lambda hz: abs(hz - 100) < 1e-3,
                 "faults.rests.turn_ratio.moves": lambda moves: moves >= 7})
      for name, harm in (("each tenth", lambda log: log[log.index % 10 > 0]),
                         ("one in thirty", lost(0.03)), ("a fifth at random", lost(0.2)))],
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
    *[Injection(f"parts of a second without leading zeros, {rate} Hz", "poses",
                unpadded(rate, first, digits), ("without leading zeros (3 ms as .3)",), True)
      for rate, first, digits in [(40.0, 0.007, 9), (125.0, 0.0004, 9), (100.0, 0.0, 3)]],
]  # fmt: skip
