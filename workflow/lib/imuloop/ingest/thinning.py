"""Fewer values of a long log: rows that are evenly spread, and means of a few."""

import numpy as np


class EvenSubsample:
    """Rows of arrays evenly spread over all that were added, at most twice `kept`."""

    def __init__(self, kept):
        self.kept, self.stride, self.seen, self.parts, self.count = kept, 1, 0, [], 0

    def add(self, rows):
        """Take in rows, shape (n, k) or (n,)."""
        # a copy, so that few rows do not hold all others
        self.parts.append(rows[-self.seen % self.stride :: self.stride].copy())
        self.seen, self.count = self.seen + len(rows), self.count + len(self.parts[-1])
        while self.count > 2 * self.kept:
            self.parts, self.stride = [self.rows()[::2]], 2 * self.stride
            self.count = len(self.parts[0])

    def rows(self):
        """Return those kept, in order, as one array."""
        return np.concatenate(self.parts) if self.count else np.empty((0, 0))


def means(x, rows):
    """Return means of blocks of a few rows, along the last axis."""
    return np.einsum("...ij->...i", x.reshape(*x.shape[:-1], x.shape[-1] // rows, rows)) / rows
