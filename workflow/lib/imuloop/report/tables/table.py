"""A table of the report: what the templates lay out."""

from dataclasses import dataclass

from imuloop.report.numbers import missing


class Sized(str):
    """Text of a cell that its column is sorted by: a size in SI, a share or a rank, or None."""

    def __new__(cls, text, value):
        """Return the text with its value."""
        cell = super().__new__(cls, text)
        cell.value = None if missing(value) else f"{value:.6g}"
        return cell


@dataclass(frozen=True)
class Table:
    """A table of the report; the first cell of each row names the row.

    Headers have units, the caption where all cells share one; the note is for those who meet these
    numbers for the first time. Cells of a dense table may break into lines. Rows sort by the values
    of `Sized` cells, else by text.
    """

    caption: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]
    note: str = ""
    dense: bool = False
    sortable: bool = False
