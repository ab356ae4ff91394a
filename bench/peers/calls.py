"""Each contender's call on the same data: ``calls NAME FOLDER``, in either environment.

For Allan curves the folder holds `axes.npy`, shape (6, n), SI, and `factors.npy`, the averaging
factors; imports and a first call on a short part are not timed. What was computed goes
to ``NAME.npy``; printed are seconds of processor time.
"""

import contextlib
import io
import sys
import time
from pathlib import Path

import numpy as np

# Hz
RATE = 100.0
# averaging times, of which the shortest coincide
COUNT = 116


def averaging_factors(n):
    """Return the averaging factors of all, spaced as `allan-variance` spaces them, about 100."""
    spaced = np.logspace(0, np.log2(n // 3), COUNT, base=2)
    return np.unique(np.rint(spaced)).astype(int)


def curves_allantools(axes, factors):
    """One axis a call."""
    from allantools import oadev

    taus = factors / RATE
    return [oadev(x, rate=RATE, data_type="freq", taus=taus)[1] for x in axes]


def curves_allan_variance(axes, factors):
    """Its averaging times are those of `factors`; an axis a call: it is three times as fast so."""
    from allan_variance import compute_avar

    times = {"tau_min": 1 / RATE, "tau_max": (factors[-1] + 0.5) / RATE}
    found = [compute_avar(x, 1 / RATE, n_clusters=COUNT, **times) for x in axes]
    assert np.array_equal(np.rint(found[0][0] * RATE), factors)
    return np.sqrt([variance for _, variance in found])


def curves_imuloop(axes, factors):
    """The curve with its intervals."""
    from imuloop.noise.allan import allan_variance, degrees_of_freedom, interval

    variances = [allan_variance([x], factors) for x in axes]
    for variance in variances:
        interval(variance, degrees_of_freedom(variance, factors, [axes.shape[1]]))
    return np.sqrt(variances)


# by distribution, as bench/requirements.txt has it
CURVES = {
    "imuloop": curves_imuloop,
    "allantools": curves_allantools,
    "allan-variance": curves_allan_variance,
}


def seconds(call, *arguments):
    """Return what a call returns, and its seconds of processor time."""
    before = time.process_time()
    values = call(*arguments)
    return values, time.process_time() - before


def main():
    name, folder = sys.argv[1], Path(sys.argv[2])
    call = globals()[name]
    # they print progress
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        axes, factors = np.load(folder / "axes.npy"), np.load(folder / "factors.npy")
        short = axes[:, : len(axes[0]) // 10].copy()
        call(short, averaging_factors(len(short[0])))
        values, took = seconds(call, axes, factors)
    np.save(folder / f"{name}.npy", np.asarray(values))
    print(took)


if __name__ == "__main__":
    main()
