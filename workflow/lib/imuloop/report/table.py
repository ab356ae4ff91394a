"""A table of the report, and its cells."""

from dataclasses import dataclass

from imuloop.report.numbers import (
    missing,
    with_sigma,
)


class Sized(str):
    """The text of a cell, with the number by which its column is sorted, `value`, or None.

    A cell of a matrix also has a `share`: its value over the largest magnitude, −1 to 1. The page
    colours the cell by it.
    """

    def __new__(cls, text, value, share=None):
        """Return the text with its value and share."""
        cell = super().__new__(cls, text)
        cell.value = None if missing(value) else f"{value:.6g}"
        cell.share = share
        return cell


@dataclass(frozen=True)
class Table:
    """A table of the report; the first cell of each row names the row.

    Headers give the units, or the caption does if all cells share one; the note explains the
    numbers. In a `dense` table the text of cells may break into lines. A reader sorts the rows of a
    `sortable` table by the values of `Sized` cells, or by their text.
    """

    caption: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]
    note: str = ""
    dense: bool = False
    sortable: bool = False


def shade(value, sigma, largest, display):
    """Return the cell of an element of a matrix, coloured if the element exceeds 2 σ.

    `value`, its standard error `sigma` and `largest`, the largest magnitude in the matrix, are in
    SI; `display` is the Display of the cell.
    """
    share = value / largest if abs(value) > 2 * (sigma or 0.0) else 0.0
    return Sized(with_sigma(value, sigma, display.factor), value, share)
