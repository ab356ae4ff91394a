"""Lines for a terminal: words and numbers that can be searched and copied."""

from imuloop.core.errors import printable

# signs of the report that a keyboard does not have
_PLAIN = str.maketrans({"\u202f": " ", "−": "-"})


def say(*lines):
    """Print lines, any objects, with plain spaces and minus signs in place of typographic ones."""
    for line in lines:
        print(printable(str(line).translate(_PLAIN)).rstrip())


def aligned(rows, indent=2):
    """Return rows of cells as lines of text with aligned columns, a list.

    `rows` are sequences of equal length, and `indent` is the number of blanks before each line.
    """
    rows = [[str(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        " " * indent + "  ".join(f"{c:<{w}}" for c, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
