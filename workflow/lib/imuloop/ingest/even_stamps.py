"""Time stamps of a sensor that samples evenly are made even: of packets, in bursts, scattered."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import next_fast_len
from scipy.ndimage import median_filter, uniform_filter1d

from imuloop.core.errors import plural
from imuloop.ingest.jitter import JitterTest

# time stamps come in bursts where the median step is less than this share of the sensor's. Rows
# that share a stamp are a packet where half of such are as far from the next stamp, or the one
# before, as their number of steps, but for this share of one
BURST = 0.5
# no transfer holds samples back longer, s: a longer pause is of the sensor, which then goes on for
# longer, too
_LONGEST_PAUSE = 0.5
# time stamps scatter where nine in ten of them take this share of a step, or more
_SCATTER = 0.12
# the median of time stamps that scatter is known to this share of a step, so that one lost sample
# shows
_KNOWN = 0.05
# parts of a log whose time stamps lie on one line
_PARTS = 20
# parts on a line, rows of a part, missing samples of a beat and repeated stamps of packets: fewer
# are an accident
_LEAST = 10
# percentiles between which nine in ten values lie
_NINE_IN_TEN = (5, 95)
# spectrum of the time stamps: mean steps of a block, and bins of time to a mean step, as many as
# blocks at most
_BLOCK, _BINS = 4096, 16
# a clock's power is above this many times the power of random stamps; frequencies that its peak
# spans
_SURE, _PEAK = 20.0, 8
# most: the power of a clock's images on a grid of stamps, of its own; the stamps that follow one
# sample after the last, of those that follow later; the transfers of one size, of all
_MOST = 0.8
# share of the stamps that follow one sample after the last, at least
_ONES = 0.3
# stamps of a running median, and stamps of a running phase
_SMOOTH, _PHASE = 9, 512
# lost samples that may be noise
_FEW = 2
# a line whose rate differs more from the declared one is not the sensor's
_RATE_SHARE = 0.02
# between so many bursts nothing is left, and what follows takes minutes to find that out
MOST_BURSTS = 1000


@dataclass(frozen=True)
class Even:
    """Samples at even steps, some of which may be lost.

    Attributes
    ----------
    step : float
        Time from sample to sample, s.
    rows, lost : sequence of int
        Rows after a loss, and the number of samples lost before each of them in total.
    complete : bool
        Whether it is known that no sample is lost.
    """

    step: float
    rows: Sequence = ()
    lost: Sequence = ()
    complete: bool = False

    def number(self, rows):
        """Return the number of the sample that each row holds."""
        return rows + np.array([0, *self.lost])[np.searchsorted(self.rows, rows, side="right")]


# times of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def even_samples(rows, t, turn_rate, packets=None, rate=None, increments=False):
    """Return the `Even` samples of a log whose time stamps are to be rebuilt; None to keep them.

    A host stamps what it receives, with a delay that varies, and receives several samples of a
    transfer at once. The samples are found in two ways:

    - by the sensor's clock, where the time stamps still show it (`_number_samples`). This tells
      lost samples from late ones.
    - by the line of the time stamps over the row number (`_on_line`). Its slope is the step.

    Time stamps of single rows stay as they are where they scatter by less than `_SCATTER`, where
    the angular rate goes with them, and where rows hold increments, whose intervals may differ.
    They stay too where the sensor pauses.

    Parameters
    ----------
    rows, t : array, shape (n,)
        Number and time, s, of each row.
    turn_rate : array, shape (3, n)
        Angular rate, of any unit.
    packets : tuple, optional
        Result of `packet_step`.
    rate : float, optional
        Declared rate, Hz.
    increments : bool
        Whether rows hold increments.
    """
    if len(t) < _LEAST * _PARTS:
        return None
    step, away = _line(rows, t)
    if not np.isfinite(1 / step):
        return None
    # not of the mean step, which a single pause can make long
    bursts, scatter = np.median(np.diff(t)) < BURST * step, _spread(away, _PARTS)
    single = not (packets or bursts)
    if single and (increments or scatter < _SCATTER * step):
        return None
    on_line = _on_line(away, scatter, step, packets, bursts)
    even, clean = Even(step) if on_line else None, False
    if numbers := _number_samples(rows, t, packets):
        first, lost, number, own_t, width = numbers
        losses = np.flatnonzero(np.diff(lost)) + 1
        own_step, _ = _line(number, own_t)
        beat = _is_beat(number[losses])
        clean = single and width < _SCATTER and not beat
        if on_line and (beat or lost[-1] <= _FEW):
            losses = losses[:0]
        if not (beat or clean or losses.size):
            even = Even(step if on_line else own_step, complete=True)
        elif losses.size and not clean and np.diff(lost).max() * own_step < _LONGEST_PAUSE:
            even = Even(own_step, first[losses], lost[losses])
    if not even or (rate and abs(even.step * rate - 1) > _RATE_SHARE):
        return None
    if packets:
        return even
    test = JitterTest(even.step, scatter)
    test.add(t, turn_rate)
    if clean:
        # a slower sensor on this grid of stamps has the same stamps: the gyroscope knows
        return replace(even, complete=True) if test.even else None
    return None if test.followed else even


def _spread(x, parts=1):
    """Return the width of the range that holds nine in ten values, the median of some parts."""
    ends = [np.percentile(part, _NINE_IN_TEN) for part in np.array_split(x, parts)]
    return np.median(np.ptp(ends, axis=1))


def _on_line(away, scatter, step, packets, bursts):
    """Tell whether times lie on a line over the row number, so that no sample is lost.

    The medians of parts of the log have to lie within the scatter of one part, those of single rows
    within half a step. Then a part is so long that its median is known to `_KNOWN` of a step.
    """
    limit, parts = max(scatter, step / 2) if packets else scatter, _PARTS
    if not (packets or bursts):
        # the error of a median of n normal values is 1.25 of their deviation over the root of n
        needed = (1.25 * scatter / 3.29 / (_KNOWN * step)) ** 2
        if not _LEAST * needed < len(away):
            return False
        limit, parts = step / 2, int(len(away) / max(needed, _LEAST))
    medians = [np.median(part) for part in np.array_split(away, parts)]
    return np.ptp(medians) <= limit and scatter <= _LONGEST_PAUSE


def _number_samples(rows, t, packets):
    """Return the number of each sample by the sensor's clock; None where stamps show no clock.

    Parameters
    ----------
    rows, t : array
        Number and time, s, of each row; of a packet its first row.
    packets : tuple or None
        Result of `packet_step`.

    Returns
    -------
    tuple or None
        For each transfer, or row: its first row, the number of samples lost before it, the number
        of its sample, and its time, s. Last, how far the stamps scatter about the clock, samples.
    """
    size, rows, t = _transfers(rows, t)
    clock = _clock(t)
    if not clock:
        return None
    # the row that the stamp is for
    stamped = rows - rows[0]
    if size == 1 and packets and packets[1]:
        stamped = stamped + np.diff(rows, append=rows[-1] + 1) - 1
        stamped = stamped - stamped[0]
    place = t * clock - _phase(t * clock)
    index = np.rint(place).astype(int)
    if size * (index[-1] - index[0]) < (1 - _RATE_SHARE) * stamped[-1]:
        # a clock of the transfers, not of the sensor
        return None
    width = _spread(place - index)
    lost = size * (index - index[0]) - stamped
    lost = median_filter(lost, _SMOOTH if width >= _SCATTER else 3)
    # after late samples others are in time again; after lost ones they are not
    lost = np.minimum.accumulate(lost[::-1])[::-1]
    lost = lost - lost[0]
    return rows, lost, stamped + lost, t, size * width


def _clock(t):
    r"""Return the frequency of the clock that time stamps show, Hz; None where they show none.

    It is a peak of the spectrum of the stamps

    .. math:: C(f) = \left|\sum_k e^{2 \pi i f t_k}\right| / n,

    between their mean rate and twice that. A normal delay of standard deviation :math:`\sigma`
    lowers C by the factor :math:`e^{-2 (\pi f \sigma)^2}`; lost samples do not lower it.
    """
    mean = (len(t) - 1) / (t[-1] - t[0])
    x = (t - t[0]) * mean
    pulses = np.bincount((x * _BINS + 0.5).astype(int))
    size = min(len(pulses), _BLOCK * _BINS)
    blocks = pulses[: len(pulses) // size * size].reshape(-1, size)
    length = next_fast_len(4 * size, real=True)
    power = np.abs(np.fft.rfft(blocks[:: len(blocks) // _BINS + 1], length)) ** 2
    f, power = np.fft.rfftfreq(length, 1 / _BINS), power.mean(axis=0) * (_BINS / size) ** 2
    f, power = (each[(f > 1 - _BINS / size) & (f <= 2)] for each in (f, power))
    # on a grid of stamps the clock has images at higher frequencies
    low = np.flatnonzero(power > _MOST * power.max())[0]
    peak = f[low + power[low : low + _PEAK].argmax()]
    for clock in (peak, 1.0):
        step = np.diff(np.rint(x * clock - _phase(x * clock)))
        ones, more = np.mean(step == 1), np.mean(step > 1)
        # a finer grid has mostly steps of two, the polls of a host have mostly steps of none
        if np.interp(clock, f, power) * size / _BINS > _SURE and ones > max(_ONES, _MOST * more):
            return clock * mean
    return None


def _phase(x):
    """Return the slowly changing phase of times in cycles, cycles."""
    wave = uniform_filter1d(np.exp(2j * np.pi * x), _PHASE)
    return np.unwrap(np.angle(wave)) / (2 * np.pi)


def _is_beat(at):
    """Tell whether samples are missing because a host polls a sensor slower than its polls.

    They are then evenly spaced by the beat of the two clocks, which is not a whole number.
    """
    if len(at) < _LEAST:
        return False
    apart, start = np.polyfit(np.arange(len(at)), at, 1)
    whole = abs(apart - round(apart)) * len(at) < _FEW
    return not whole and _spread(at - apart * np.arange(len(at)) - start) < _FEW


def _transfers(rows, t):
    """Return size, first rows and times of transfers; of single rows where the size differs."""
    mean = (t[-1] - t[0]) / (len(t) - 1)
    for starts in (np.arange(len(t)), np.append(0, 1 + np.flatnonzero(np.diff(t) >= BURST * mean))):
        size = np.diff(rows[starts])
        usual = int(np.median(size)) if len(size) else 1
        # a few parts between long gaps are none
        if usual > 1 and len(size) >= _LEAST and np.mean(size == usual) >= _MOST:
            # the first and the last one may be incomplete
            return usual, rows[starts][1:-1], t[starts][1:-1]
    return 1, rows, t


def _line(rows, t):
    """Return the slope of time over row number, and how far each time is from that line.

    By Theil's method, the median slope of pairs half a log apart; then, as stamps of transfers lie
    on a few lines and it leads from one to another, by three rounds of least squares of what it
    leaves, outliers clipped.
    """
    rows, half = rows - rows[0], len(rows) // 2
    step = np.median((t[half:] - t[:-half]) / (rows[half:] - rows[:-half])).item()
    middle = rows - rows.mean()
    for _ in range(3):
        away = t - step * rows
        near = np.clip(away, *np.percentile(away, _NINE_IN_TEN))
        step += (middle @ near / (middle @ middle)).item()
    return step, t - step * rows


# times of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def packet_step(rows, t, repeats, rate=None):
    """Return the step of rows that share the stamp of their packet, s, and if it is the last one's.

    None where such rows are no packet: then the stamps around them go on as always. The step is by
    the declared `rate`, Hz, else that from stamp to stamp over the number of rows. `rows` and `t`
    are number and time, s, of each row with a new stamp, `repeats` the number of other rows.
    """
    if repeats < _LEAST or len(t) < 3:
        return None
    # of each stamp the number of rows, and the steps to the stamp before and to the next
    size, steps, found = np.diff(rows)[1:], np.diff(t), []
    for last, away in ((True, steps[:-1]), (False, steps[1:])):
        step = 1 / rate if rate else np.median(away / size).item()
        fits = (away / step > size - BURST)[size > 1]
        found.append((fits.mean() if fits.size else 0.0, last, step))
    share, last, step = max(found)
    return (step, last) if share >= BURST else None


def spread(x, readable, step, last):
    """Return stamps in which rows that share one are a `step` apart, in units of the stamps.

    Theirs is of the `last` row, else of the first. No row comes before the stamp before, nor after
    the next one.
    """
    own = x[readable]
    starts = np.flatnonzero(np.append(True, own[1:] != own[:-1]))
    size = np.diff(starts, append=len(own))
    number = np.arange(len(own)) - np.repeat(starts + (size - 1) * last, size)
    stamps = own[starts]
    away = np.diff(stamps, prepend=stamps[0]) if last else np.diff(stamps, append=stamps[-1])
    width = np.where(away > 0, np.minimum(step, away / size), step)
    moved = x.copy()
    moved[readable] = own + (number * np.repeat(width, size)).astype(x.dtype)
    return moved


# times of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def rebuilt_line(timing, logged):
    """Return the line on time stamps that were rebuilt as `Even` samples, or within packets.

    `timing` is the `Timing` of the log, `logged` are the figures as of quality.json of its times as
    stamped.
    """
    even, packets, t = timing.even, timing.packets, timing.logged
    median, mean = np.median(np.diff(t)) * 1e3, (t[-1] - t[0]) / (len(t) - 1) * 1e3
    shared = f"the stamps of {timing.repeats} rows are those of others, as of packets of samples"
    if not even:
        return f"{shared}: they are put {packets[0]:.6g} s apart within each packet"
    done = f": t is rebuilt from the row number at {1 / even.step:.6g} Hz"
    if len(even.lost):
        done += f" with {plural(int(even.lost[-1]), 'lost sample')} between"
    pauses = f"{done}; where the sensor itself pauses, give rate in Hz"
    if packets:
        return shared + pauses
    if median * 1e-3 < BURST * even.step:
        return (
            f"the stamps come in bursts (median step {median:.3g} ms, mean {mean:.3g} ms){pauses}"
        )
    known = ", no sample is lost" if even.complete else ""
    if gaps := logged["gaps"]["count"]:
        known += f", though {gaps} of the steps look like gaps"
    if not (even.complete or len(even.lost)):
        known += ", so that lost samples would not show"
    return f"the stamps scatter about a regular clock{known}{done}"


# times of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def bursts_fault(t, gaps, rate=None):
    """Return what is wrong with time stamps in bursts that no line could rebuild, or None.

    A sensor that pauses by itself pauses for long, goes on for a second or more, or has the
    declared `rate`, Hz, in between. `t` are times, s, and `gaps` their gaps as in quality.json.
    """
    if len(t) < 2:
        return None
    median, mean = np.median(np.diff(t)), (t[-1] - t[0]) / (len(t) - 1)
    stretch = (t[-1] - t[0] - gaps["total_s"]) / (gaps["count"] + 1)
    pauses = gaps["total_s"] > _LONGEST_PAUSE * max(gaps["count"], 1) or stretch >= _LONGEST_PAUSE
    if pauses or median >= BURST * mean or (rate and abs(median * rate - 1) < _RATE_SHARE):
        return None
    return (
        f"the stamps come in bursts (median step {median * 1e3:.3g} ms, mean {mean * 1e3:.3g} ms) "
        f"with {gaps['count']} gaps between, and lie on no line: rows are lost, or held back. If "
        "the sensor itself samples evenly, take the row's number for the time: columns.time: null, "
        f"and about rate: {1 / mean:.4g}"
    )
