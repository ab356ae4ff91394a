"""JSON lines: an object with the numbers of a sample per line, read as a text table."""

import csv
import io
import json
from itertools import islice

from imuloop.core.errors import RejectedLog, one_line
from imuloop.ingest import delimited
from imuloop.ingest.damage import LONGEST_LINE
from imuloop.ingest.tables import HEAD_ROWS
from imuloop.ingest.text_layout import JSON_DOCUMENT, parts_of


def read(paths, columns=None):
    """Return the RawLog of a log of JSON lines: one object with the numbers of a sample per line.

    ``paths["log"]`` is the path of the file; a compressed file is unpacked. The columns are the
    members of the objects in the first rows. A member of an object inside another is the column
    ``OBJECT.MEMBER``, and the members of a list are ``LIST[0]``, ``LIST[1]`` and so on. A line that
    is not an object is a bad line. `columns` are the declared columns by quantity, or None.
    """
    lines = b"".join(parts_of(paths["log"], LONGEST_LINE)).splitlines()
    rows = list(filter(None, map(_members, islice(lines, HEAD_ROWS))))
    names = list(dict.fromkeys(name for row in rows for name in row))
    if len(rows) < 2:
        raise RejectedLog(JSON_DOCUMENT)
    table = io.StringIO(newline="")
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(names)
    for line in lines:
        if (row := _members(line)) is not None:
            writer.writerow([row.get(name, "") for name in names])
        elif line.strip():
            # a row of a single field, which the reader of tables counts as a bad line
            writer.writerow(["?" * min(len(line), LONGEST_LINE)])
    return delimited.read({"log": table.getvalue().encode()}, columns)


def holds_log(path):
    """Return whether a JSON file looks like a log, not like a result of imuloop.

    A log has JSON lines or a list of objects. `path` is the path of the file.
    """
    with open(path, "rb") as file:
        head = file.read(LONGEST_LINE)
    return are_objects(head) or (head.lstrip().startswith(b"[") and b"{" in head)


def are_objects(head):
    """Return whether the first two lines in `head`, the first bytes of a file, are JSON objects."""
    first = [line for line in head.splitlines() if line.strip()][:2]
    return len(first) == 2 and all(map(_members, first))


def _members(line):
    """Return the members of a JSON object as text, a dict by name; None if a line is not an object.

    `line` is the line of the file, bytes. Members of inner objects and lists are named as in
    `read`.
    """
    if not line.lstrip().startswith(b"{") or len(line) > LONGEST_LINE:
        return None
    try:
        # numbers stay as they are written
        row = json.loads(line, parse_float=str, parse_int=str)
        return dict(_flat(row))
    except (ValueError, RecursionError):
        return None


def _flat(value, name=""):
    """Yield the name and the text of each number or text inside of a JSON value, at any depth.

    `value` is the value, and `name` its own name, empty for the whole object.
    """
    if isinstance(value, dict):
        for key, member in value.items():
            yield from _flat(member, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        for number, member in enumerate(value):
            yield from _flat(member, f"{name}[{number}]")
    else:
        yield one_line(name), "" if value is None else one_line(value)
