"""Tables as dicts of arrays, one a column: made of records, cut to rows, in groups."""

import numpy as np


def from_records(records):
    """Return the columns of dicts, a row each, as arrays; what one lacks is None."""
    names = dict.fromkeys(name for record in records for name in record)
    return {name: [record.get(name) for record in records] for name in names}


def rows(table, where):
    """Return the rows of a table that a mask or an index chooses."""
    return {name: values[where] for name, values in table.items()}


def groups(keys):
    """Return the distinct values of an array in order, each with the mask of its rows."""
    return {key: keys == key for key in np.unique(keys).tolist()}
