"""Rows of samples: ranges of them from a file or a table, in memory that does not grow with it."""

from collections import OrderedDict

import numpy as np

from imuloop.core.samples import TIME, Columns, parquet_file, values

# rows of a piece: 8 columns of it are 8 MB
ROWS = 1 << 17
# row groups that are held: a range across two of them, read again half a range later
_HELD = 3
# numbers from which the place of a median is told, before it is looked for
_TOLD = 1 << 16


class Rows:
    """Ranges of rows of samples; of a file few row groups are held, of a table nothing is copied.

    Parameters
    ----------
    samples : Columns, DataFrame or dict
        Columns as in `imuloop.core.samples`.

    Attributes
    ----------
    names : tuple of str
        Columns.
    """

    def __init__(self, samples):
        self._table, self._file = samples, None
        if isinstance(samples, Columns):
            self._file = parquet_file(samples.path, pre_buffer=False)
            metadata = self._file.metadata
            rows = [metadata.row_group(g).num_rows for g in range(metadata.num_row_groups)]
            self._edges = np.cumsum([0, *rows])
            self._groups = OrderedDict()
        self.names = tuple(samples.names if self._file else samples)
        # of a dict the length is that of a column
        self._count = len(samples if self._file else samples[self.names[0]])

    def __len__(self):
        return self._count

    def read(self, names, first, last):
        """Return columns of a range of rows, shape (len(names), last - first)."""
        names = tuple(names)
        if self._file is None:
            return np.array([np.asarray(self._table[name])[first:last] for name in names], float)
        low, high = np.searchsorted(self._edges, (first, last - 1), side="right") - 1
        out = np.empty((len(names), last - first))
        for g in range(low, high + 1):
            edge = self._edges[g]
            begin, end = max(first, edge), min(last, self._edges[g + 1])
            group = self._group(names, g)
            out[:, begin - first : end - first] = group[:, begin - edge : end - edge]
        return out

    def _group(self, names, g):
        """Return columns of a row group."""
        key = names, g
        if key not in self._groups:
            # rows of one column are read at least twice, those of many once
            while len(self._groups) >= _HELD:
                self._groups.popitem(last=False)
            table = self._file.read_row_group(g, columns=list(names), use_threads=False)
            self._groups[key] = np.array([values(table[name]) for name in names])
        self._groups.move_to_end(key)
        return self._groups[key]

    def at(self, name, rows):
        """Return a column's values at some rows, in order, shape of `rows`."""
        rows = np.asarray(rows, dtype=int)
        if self._file is None:
            return np.asarray(self._table[name], dtype=float)[rows]
        out = np.empty(rows.shape)
        groups = np.searchsorted(self._edges, rows, side="right") - 1
        for g in np.unique(groups):
            out[groups == g] = self._group((name,), g)[0, rows[groups == g] - self._edges[g]]
        return out

    def pieces(self, names, rows=ROWS):
        """Yield the first row of each piece and its columns, shape (len(names), n)."""
        for first in range(0, self._count, rows):
            yield first, self.read(names, first, min(first + rows, self._count))

    def time_steps(self, rows=ROWS):
        """Yield the first row of each piece and the steps of time that end after its rows, s."""
        for first in range(0, self._count - 1, rows):
            yield first, np.diff(self.read((TIME,), first, min(first + rows + 1, self._count))[0])


def sums_over(values, ranges):
    """Return sums of values over ranges of their rows, what lies before and behind them left out.

    Parameters
    ----------
    values : ndarray, shape (n,) or (n, k)
        Of a piece, say.
    ranges : ndarray of int, shape (m, 2)
        First row and the one behind the last.

    Returns
    -------
    ndarray, shape (m,) or (m, k)
    """
    if values.ndim > 1:
        return np.column_stack([sums_over(column, ranges) for column in values.T])
    total, inside = np.zeros(len(ranges)), np.clip(ranges, 0, len(values))
    near = inside[:, 0] < inside[:, 1]
    if near.any():
        # a range may end behind the last row
        total[near] = np.add.reduceat(np.append(values, 0.0), inside[near].ravel())[::2]
    return total


def median_step(rows):
    """Return the median step of time, s, as numpy has it of all; None of fewer than two samples.

    A part of the steps, evenly spread, brackets the median; a pass counts what is below the
    bracket and holds each value inside once. Should it miss the median, a wider one follows.
    """
    n = len(rows) - 1
    if n < 1:
        return None
    stride = n // _TOLD + 1
    told = np.sort(np.concatenate([s[-first % stride :: stride] for first, s in rows.time_steps()]))
    ranks, margin = np.array([(n - 1) // 2, n // 2]), 2 * int(np.sqrt(len(told))) + 2
    while True:
        low, high = len(told) // 2 - margin, len(told) // 2 + margin
        low = told[low] if low >= 0 else -np.inf
        high = told[high] if high < len(told) else np.inf
        below, found = 0, {}
        for _, steps in rows.time_steps():
            below += np.count_nonzero(steps < low)
            inside = steps[(steps >= low) & (steps <= high)]
            for value, count in zip(*np.unique(inside, return_counts=True), strict=True):
                found[value] = found.get(value, 0) + count
        margin *= 8
        values = np.array(sorted(found))
        reached = below + np.cumsum([found[value] for value in values], dtype=int)
        if below <= ranks[0] and reached.size and ranks[1] < reached[-1]:
            return float(np.mean(values[np.searchsorted(reached, ranks, side="right")]))
