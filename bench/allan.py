"""Allan curves of six axes with their intervals beside `allantools.oadev` alone.

``python -m bench.allan`` prints processor times of one thread, their ratio and the largest relative
difference of the deviations.
"""

import time

import numpy as np
from allantools import oadev

from bench.study.tables import table
from imuloop.core.noise_model import AxisNoise
from imuloop.core.samples import CHANNELS
from imuloop.noise.allan import allan_table, allan_variance
from imuloop.noise.curve_covariance import curve_covariance, degrees_of_freedom

# 8.5 h at 100 Hz
ROWS, RATE = 3_060_000, 100.0
# averaging factors up to a third of the record, about 100 of them
FACTORS = np.unique(np.rint(np.geomspace(1, ROWS / 3, 110)).astype(int))
# best of so many, in turn
ROUNDS = 3


def curves(axes):
    """Return the deviations of each axis and the processor time of curves and of intervals, s."""
    begin = time.process_time()
    variances = [allan_variance([x], FACTORS) for x in axes]
    middle = time.process_time()
    spread = curve_covariance(FACTORS, [ROWS], RATE, reach=1.0)
    tau = FACTORS / RATE
    edf = degrees_of_freedom(AxisNoise(), tau, spread)
    tables = [allan_table(name, tau, v, edf) for name, v in zip(CHANNELS, variances, strict=True)]
    end = time.process_time()
    return [each["adev"] for each in tables], middle - begin, end - middle


def peer(axes):
    """Return the deviations of each axis by allantools and its processor time, s."""
    begin = time.process_time()
    found = [oadev(x, rate=RATE, data_type="freq", taus=FACTORS / RATE)[1] for x in axes]
    return found, time.process_time() - begin


def measure():
    """Return the best times of curves, intervals and the peer, s, and the largest difference."""
    random = np.random.default_rng(0)
    axes = [random.standard_normal(ROWS) + 9.8 * (k == 2) for k in range(6)]
    times, difference = [], 0.0
    for _ in range(ROUNDS):
        own, *seconds = curves(axes)
        other, alone = peer(axes)
        times.append((*seconds, alone))
        difference = max(np.abs(np.array(own) / other - 1).max(), difference)
    return *np.min(times, axis=0), float(difference)


def main():
    """Print the table."""
    curve, intervals, alone, difference = measure()
    seconds = {
        "imuloop, curves": curve,
        "imuloop, degrees of freedom and intervals": intervals,
        "imuloop, both": curve + intervals,
        "allantools.oadev alone": alone,
    }
    rows = [[name, f"{s:.2f}", f"{s / alone:.2f}"] for name, s in seconds.items()]
    print(f"Six axes of {ROWS:,} samples, {len(FACTORS)} averaging times.\n")
    print(table(("", "s of CPU", "ratio"), rows))
    print(f"\nLargest relative difference of a deviation: {difference:.1e}.")


if __name__ == "__main__":
    main()
