"""Even time stamps for a sensor that samples evenly, but whose host stamps samples unevenly."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import next_fast_len
from scipy.ndimage import median_filter, uniform_filter1d

from imuloop.core.errors import plural
from imuloop.ingest.jitter import jitter_sign

# Time stamps come in bursts if the median step is less than this share of the mean one. Rows that
# share a time stamp are a packet if the time before or after it has as many steps, less this share
# of a step. A transfer holds samples back for less than this time, s. A lower peak of a spectrum
# counts as the highest if it has more than this share of its power.
HALF = 0.5
# stamps are made even if the range that holds nine in ten of them is at least this share of a step:
# a smaller range is noise of a host's clock
SCATTER = 0.12
# a smaller number of transfers, missing samples, or rows with a shared stamp may be an accident
ENOUGH = 20
# number of parts of a log, of at least ten rows each, that are tested for whether their stamps lie
# on one line: fewer parts hide lost samples
PARTS = 20
# number of bins per mean step in the spectrum of the stamps, and the least power of a clock in it,
# in units of the power of random stamps
_BINS, _SURE = 20, 20
# mean steps in a block of that spectrum, and time stamps in a running mean of the phase: clocks
# drift slowly
_BLOCK, _PHASE = 4096, 512
# transfers have one size if this share of them has it
_ONE_SIZE = 0.8
# a declared rate and the rate of the stamps count as the same if they differ by less than this
# share
RATE_SHARE = 0.05


@dataclass(frozen=True)
class Even:
    """Samples at even steps of time, some of which may be lost.

    `step` is the time from sample to sample, s. `rows` are the numbers of the m rows just after a
    loss, (m,) of int, and `lost` is the number of all samples lost before each of these rows, since
    the start of the log, (m,) of int.
    """

    step: float
    rows: Sequence = ()
    lost: Sequence = ()

    def number(self, rows):
        """Return the numbers of the samples in k rows, with lost samples counted, too, (k,) of int.

        `rows` are the numbers of these rows, in which lost samples are not counted, (k,) of int.
        """
        return rows + np.array([0, *self.lost])[np.searchsorted(self.rows, rows, side="right")]


# times of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def even_samples(rows, t, turn_rate, packets=None, rate=None, increments=False):
    """Return the `Even` samples from which time stamps are to be rebuilt; None to keep the stamps.

    A host stamps samples when it receives them. Its delay varies, and it may receive several
    samples at once. Two ways lead to the step of the sensor:

    - The spectrum of the time stamps may show the sensor's clock. Then lost samples are told from
      late ones.
    - The time stamps may lie on a line over the row number. Then its slope is the step.

    Time stamps are kept if the angular rate shows that samples were taken at them. If rows do not
    come in bursts or packets, they are also kept if they scatter by less than `SCATTER` of a step,
    or if rows hold increments, whose intervals may differ.

    Parameters
    ----------
    rows, t : array, shape (n,)
        Number and time, s, of each row.
    turn_rate : array, shape (3, n)
        Angular rate, in any unit.
    packets : tuple, optional
        The result of `packet_step`, if rows come in packets that share a time stamp.
    rate : float, optional
        Declared rate, Hz.
    increments : bool
        Whether rows hold increments.
    """
    if len(t) < 10 * PARTS:
        return None
    mean = (t[-1] - t[0]) / (rows[-1] - rows[0])
    if np.ptp(t - mean * rows) < SCATTER / 2 * mean and not packets:
        # evenly spaced as they are; this spares long logs the line
        return None
    step, away = _line(rows, t)
    scatter = _width(away)
    single = not packets and np.median(np.diff(t)) >= HALF * step
    too_even = single and (increments or scatter < SCATTER * step)
    if too_even or not np.isfinite(1 / step):
        return None
    medians = [np.median(part) for part in np.array_split(away, PARTS)]
    on_line = np.ptp(medians) <= (step / 2 if single else max(scatter, step / 2))
    even, clean = Even(step) if on_line else None, False
    if by_clock := _by_clock(rows, t, packets):
        lossy, width, beat = by_clock
        clean = single and width < SCATTER and not beat
        # a host that polls faster than the sensor samples misses nothing, and one or two losses of
        # stamps on a line may be noise
        complete = on_line and (beat or np.max(lossy.lost, initial=0) <= 2)
        longest = np.diff(lossy.lost, prepend=0).max(initial=0) * lossy.step
        if not (clean or complete) and longest < HALF:
            even = lossy
    if not even or (rate and abs(even.step * rate - 1) > RATE_SHARE):
        return None
    sign = 0 if packets else jitter_sign(t, turn_rate, even.step, scatter)
    # if the stamps show a clock, it may be the sensor's or a grid: the angular rate has to tell
    return even if sign < (0 if clean else 1) else None


def _width(x):
    """Return the scatter of n values: the width of the range that holds nine in ten of them.

    `x` are the values, (n,). The width is the median of the widths in `PARTS` consecutive parts of
    them, so that a slow drift does not count.
    """
    ends = [np.percentile(part, (5, 95)) for part in np.array_split(x, PARTS)]
    return np.median(np.ptp(ends, axis=1))


def _line(rows, t):
    """Return the slope of a line of time over row number, s, and the times less this line, s, (n,).

    `rows` and `t` are number and time, s, of each of n rows, (n,). The slope is first the median
    over pairs of rows half a log apart (Theil). Because stamps of transfers lie on a few parallel
    lines, three rounds of least squares with clipped outliers follow.
    """
    rows, half = rows - rows[0], len(rows) // 2
    step = np.median((t[half:] - t[:-half]) / (rows[half:] - rows[:-half])).item()
    middle = rows - rows.mean()
    for _ in range(3):
        away = t - step * rows
        near = np.clip(away, *np.percentile(away, (5, 95)))
        step += (middle @ near / (middle @ middle)).item()
    return step, t - step * rows


def _by_clock(rows, t, packets):
    """Return the `Even` samples by the sensor's clock; None if the time stamps show no clock.

    `rows` and `t` are number and time, s, of each of n rows, (n,); if rows come in packets that
    share a time stamp, of the first row of each packet. `packets` is the result of `packet_step`,
    None if rows do not come in packets.

    Returns
    -------
    samples : Even
        The samples, with the lost ones.
    width : float
        Width of the scatter of the time stamps about the clock, in steps of the sensor.
    beat : bool
        Whether samples only seem to be lost, because a host polls faster than the sensor samples.
    """
    size, rows, t = _transfers(rows, t)
    clock = _clock(t)
    if not clock:
        return None
    stamped = rows - rows[0]
    if size == 1 and packets and packets[1]:
        # the time stamp belongs to the last row of a packet
        stamped = np.append(rows[1:], rows[-1] + 1) - rows[1]
    place = t * clock - _phase(t * clock)
    index = np.rint(place).astype(int)
    if size * (index[-1] - index[0]) < (1 - RATE_SHARE) * stamped[-1]:
        # a clock of the transfers, not of the sensor
        return None
    width = _width(place - index)
    lost = size * (index - index[0]) - stamped
    # where stamps scatter, some samples are numbered one too high or low
    lost = median_filter(lost, 9 if width >= SCATTER else 3)
    # after late samples others are in time again; after lost ones they are not
    lost = np.minimum.accumulate(lost[::-1])[::-1]
    lost = lost - lost[0]
    losses, number = np.flatnonzero(np.diff(lost)) + 1, stamped + lost
    samples = Even(_line(number, t)[0], rows[losses], lost[losses])
    return samples, size * width, _is_beat(number[losses])


def _transfers(rows, t):
    """Return the number of rows in a transfer, the first rows of k transfers, and their times.

    A transfer has the rows that a host receives at once: a packet with one time stamp, or a burst.
    The second result, (k,), has the number of the first row of each transfer, and the third the
    time of this row, s, (k,). If the transfers differ in size, each row counts as one. Otherwise
    the first and the last one in the log are left out, because they may be incomplete. `rows` and
    `t` are number and time, s, of each of n rows, (n,).
    """
    apart = np.diff(t) >= HALF * (t[-1] - t[0]) / (len(t) - 1)
    # packets with a shared time stamp, else bursts
    for starts in (np.arange(len(t)), np.append(0, 1 + np.flatnonzero(apart))):
        size = np.diff(rows[starts])
        usual = int(np.median(size)) if len(size) >= ENOUGH else 1
        if usual > 1 and np.mean(size == usual) >= _ONE_SIZE:
            # the first and the last one may be incomplete
            return usual, rows[starts][1:-1], t[starts][1:-1]
    return 1, rows, t


def _clock(t):
    r"""Return the frequency of the clock that time stamps show, Hz; None if they show none.

    `t` are the n time stamps t_k, s, (n,). The frequency is a peak of the spectrum of the stamps

    .. math:: C(f) = \left|\sum_k e^{2 \pi i f t_k}\right| / n,

    between their mean rate and twice that. A normal delay of standard deviation :math:`\sigma`
    lowers C by the factor :math:`e^{-2 (\pi f \sigma)^2}`; lost samples do not lower it. If several
    peaks are high, the lowest frequency is taken, because higher ones may be its images. If it is
    not the clock, the mean rate itself is tried.
    """
    mean = (len(t) - 1) / (t[-1] - t[0])
    x = (t - t[0]) * mean
    pulses = np.bincount((x * _BINS + 0.5).astype(int))
    size = min(len(pulses), _BLOCK * _BINS)
    blocks = pulses[: len(pulses) // size * size].reshape(-1, size)
    length = next_fast_len(4 * size, real=True)
    power = np.abs(np.fft.rfft(blocks[:: len(blocks) // _BINS + 1], length)) ** 2
    # in units of the power of random stamps
    f, power = np.fft.rfftfreq(length, 1 / _BINS), power.mean(axis=0) * _BINS / size
    inside = (f > 1 - _BINS / size) & (f <= 2)
    f, power = f[inside], power[inside]
    # on a grid of stamps the clock has images at higher frequencies; a peak spans four
    low = np.flatnonzero(power > HALF * power.max())[0]
    peak = f[low + power[low : low + _BINS // 2].argmax()]
    for clock in (peak, 1.0):
        step = np.diff(np.rint(x * clock - _phase(x * clock)))
        # a finer grid has mostly steps of two, the polls of a host have mostly steps of none
        is_clock = np.mean(step == 1) > np.mean(step > 1)
        if is_clock and np.interp(clock, f, power) > _SURE:
            return clock * mean
    return None


def _phase(x):
    """Return the phase of times against a clock, a running mean over `_PHASE` times, cycles, (n,).

    `x` are the n times in cycles of the clock, (n,). The phase is constant while the times follow
    the clock.
    """
    wave = uniform_filter1d(np.exp(2j * np.pi * x), _PHASE)
    return np.unwrap(np.angle(wave)) / (2 * np.pi)


def _is_beat(samples):
    """Return whether samples only seem to be lost, because a host polls faster than a sensor.

    `samples` has the number of the sample at each of m losses, (m,). A host that polls faster finds
    no new sample from time to time. These losses are evenly spaced, by a number of samples that is
    not whole: the beat of the clocks of host and sensor.
    """
    if len(samples) < ENOUGH:
        return False
    apart, away = _line(np.arange(len(samples)), samples)
    whole = abs(apart - round(apart)) * len(samples) < 2
    return not whole and np.ptp(np.percentile(away, (5, 95))) < 2


# times of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def packet_step(rows, t, repeats):
    """Return the step between the rows of a packet, s, and whether the stamp is of its last row.

    A packet has the rows that share a time stamp. The stamp is the time of its last row, or else of
    its first. The result is None if rows that share a stamp are not packets: if the steps between
    stamps do not grow with the number of rows. `rows` and `t` are number and time, s, of each of n
    rows with a new time stamp, (n,). `repeats` is the number of rows that repeat the newest time
    stamp before them; with too few of them the result is None, too.
    """
    if repeats < ENOUGH or len(t) < 3:
        return None
    # number of rows with each time stamp, and the steps to the stamps before and after it
    size, steps, ways = np.diff(rows)[1:], np.diff(t), []
    for is_last, away in ((True, steps[:-1]), (False, steps[1:])):
        step = np.median(away / size).item()
        fits = (away / step > size - HALF)[size > 1]
        ways.append((fits.mean() if fits.size else 0.0, is_last, step))
    share, is_last, step = max(ways)
    return (step, is_last) if share >= HALF else None


def spread(x, readable, step, is_last):
    """Return time stamps, (n,), in which the rows of a packet are a `step` apart.

    A packet has the rows that share a time stamp. `x` are the time stamps of n rows, (n,), in the
    unit of `step`, and `readable` is the mask of the stamps that are used, (n,). The last row of a
    packet keeps the shared time stamp if `is_last`, else the first row. No row is moved past the
    neighbouring time stamps.
    """
    logged = x[readable]
    starts = np.flatnonzero(np.append(True, logged[1:] != logged[:-1]))
    size, stamps = np.diff(starts, append=len(logged)), logged[starts]
    number = np.arange(len(logged)) - np.repeat(starts + (size - 1) * is_last, size)
    ends = {"prepend": stamps[0]} if is_last else {"append": stamps[-1]}
    away = np.diff(stamps, **ends)
    width = np.where(away > 0, np.minimum(step, away / size), step)
    moved = x.copy()
    moved[readable] = logged + (number * np.repeat(width, size)).astype(x.dtype)
    return moved


def rebuilt_line(rows):
    """Return the line for the user on time stamps that were made even, or spread within packets.

    `rows` are the `Rows` of the log.
    """
    why, even = "come in bursts, or scatter about a regular clock", rows.even
    if rows.packets:
        why = f"of {rows.repeats} rows are those of others, as of packets of samples"
    if not even:
        return f"the stamps {why}: they are put {rows.packets[0]:.6g} s apart within each packet"
    lost = f" with {plural(int(even.lost[-1]), 'lost sample')} between" if len(even.lost) else ""
    return (
        f"the stamps {why}: t is rebuilt from the row number at {1 / even.step:.6g} Hz{lost}; "
        "where the sensor itself pauses, give rate in Hz"
    )
