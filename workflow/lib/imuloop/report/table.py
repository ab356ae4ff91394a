"""A table of the report: what the templates lay out."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """A table; the first cell of each row names the row.

    Attributes
    ----------
    caption : str
        What the table holds, with the unit where all cells share it.
    columns : tuple of str
        Headers, each with its unit.
    rows : tuple of tuple of str
        Cells, as many as there are columns.
    note : str
        One line for who meets these numbers for the first time.
    dense : bool
        Whether the cells are many and may break into lines.
    heads : tuple of int
        Rows that open a group: its name, then the unit of each column in this group.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    dense: bool = False
    heads: tuple[int, ...] = ()
