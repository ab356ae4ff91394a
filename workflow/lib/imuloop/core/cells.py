"""Cells of CSV files that hold text of a config or a log: none that a spreadsheet would run."""

import pyarrow as pa

# how a formula begins, with what is skipped before it
_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")


def text_cell(text):
    """Return a text that stays one in a spreadsheet: with an apostrophe if it begins as a formula.

    Numbers are no text: they are written as they are.
    """
    return f"'{text}" if text.startswith(_FORMULA) else text


def text_cells(table):
    """Return an Arrow table with each column of text as `text_cell` has it."""
    for place, field in enumerate(table.schema):
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        if pa.types.is_string(kind) or pa.types.is_large_string(kind):
            texts = [text and text_cell(text) for text in table.column(place).to_pylist()]
            table = table.set_column(place, field.name, pa.array(texts, kind))
    return table
