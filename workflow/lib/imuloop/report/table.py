"""A table of the report, and its cells."""

from dataclasses import dataclass

from imuloop.report.numbers import (
    missing,
    with_sigma,
)


class Sized(str):
    """The text of a table cell, with the number `value` by which its column is sorted, or None.

    A cell of a matrix also has a `share`, −1 to 1, by which the page colours the cell: its value
    divided by the largest magnitude in the matrix. In any other cell `share` is None.
    """

    def __new__(cls, text, value, share=None):
        """Return the cell with this `text`, the number `value` or None, and the `share` or None."""
        cell = super().__new__(cls, text)
        cell.value = None if missing(value) else f"{value:.6g}"
        cell.share = share
        return cell


@dataclass(frozen=True)
class Table:
    """A table of the report; the first cell of each row names the row.

    `columns` are the headers, which give the units, unless the `caption` gives one unit for all
    cells. The `note` explains the numbers. In a `dense` table the text of cells may break into
    lines. A `sortable` table can be sorted by a reader, by the values of `Sized` cells or by the
    text of others.
    """

    caption: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]
    note: str = ""
    dense: bool = False
    sortable: bool = False


def shade(value, sigma, largest, display):
    """Return the cell of an element of a matrix, coloured if the element exceeds 2 σ in magnitude.

    `value` is the element, `sigma` its standard error σ or None, and `largest` the largest
    magnitude in the matrix, all in SI. `display` is the Display of the cell, the unit in which it
    is shown.
    """
    share = value / largest if abs(value) > 2 * (sigma or 0.0) else 0.0
    return Sized(with_sigma(value, sigma, display.factor), value, share)
