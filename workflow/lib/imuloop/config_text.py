"""Faults of a config's text: it is no YAML, or YAML reads it otherwise than the user means it.

The latter are keys given twice, and values that YAML 1.1 takes for another type: 1e-3, on,
12:30:00, 007.
"""

import json
import math
import re
import sys
from pathlib import Path

import yaml

from imuloop.core.errors import one_line

# the loader of libyaml, where it is installed, is much faster
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
# patterns of values that YAML takes for another type than the user, and this type
_TRAPS = (
    (r"[-+]?[0-9][0-9_]*(\.[0-9]*)?[eE][-+]?[0-9]+", "str"),
    (r"(?i)on|off|yes|no", "bool"),
    (r"[-+]?[0-9]+(:[0-9]+)+(\.[0-9]*)?", "int|float"),
    (r"[-+]?0[0-9_]+", "int"),
    (r"(?i)[-+]?\.(nan|inf)", "float"),
)
# pattern of the type, by YAML, and the text of further keys that YAML does not take for text
_NO_NAME = r"(?i)bool (true|false)|null .*"


def unreadable(path):
    """Return why a file holds no config, a line of text with its path; None if it holds one."""
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return f"{path}: there is no such file here; write one, or name one with --configfile"
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        return one_line(f"{path}{where}: no YAML: {getattr(error, 'problem', None) or error}")
    except Exception as error:
        # text that is not UTF-8; an impossible date, number or truth value
        return one_line(f"{path}: cannot be read: {error}")
    if not isinstance(content, dict):
        kind = "empty" if content is None else "not a mapping of keys"
        return f"{path}: {kind}; it needs devices"
    return None


def key_lines(text):
    """Return the number of the line of each key in a config's text, a dict.

    A key is the tuple of all names and indices that lead to a value.
    """
    lines, waiting = {}, [((), yaml.compose(text, LOADER))]
    while waiting:
        key, node = waiting.pop()
        if isinstance(node, yaml.MappingNode):
            found = [(name.value, name, value) for name, value in node.value]
        elif isinstance(node, yaml.SequenceNode):
            found = [(i, value, value) for i, value in enumerate(node.value)]
        else:
            found = []
        for part, place, value in found:
            lines.setdefault((*key, part), place.start_mark.line + 1)
            waiting.append(((*key, part), value))
    return lines


def yaml_faults(text):
    """Yield (key, fault) for each value that YAML reads otherwise than the user means it.

    A key is the tuple of all names and indices that lead to the value in the config's `text`.
    """
    traps = _TRAPS
    try:
        # Snakemake reads a config that is JSON as JSON, in which these values have no other type
        json.loads(text)
        traps = ()
    except ValueError:
        pass
    yield from _faults(yaml.compose(text, LOADER), (), traps)


def _faults(node, key, traps):
    """Yield (key, fault) for a node of YAML at a key, and for all nodes below it.

    `traps` are the patterns of values, with types, that are faults.
    """
    if isinstance(node, yaml.MappingNode):
        seen = set()
        for name, value in node.value:
            below = (*key, name.value)
            if name.value in seen:
                line = name.start_mark.line + 1
                yield below, f"given twice (again in line {line}); only one would count"
            seen.add(name.value)
            if traps and re.fullmatch(_NO_NAME, f"{_yaml_type(name)} {name.value}"):
                yield below, f"'{name.value}' is not text to YAML; write it in quotes"
            yield from _faults(name, below, traps)
            yield from _faults(value, below, traps)
    elif isinstance(node, yaml.SequenceNode):
        for i, value in enumerate(node.value):
            yield from _faults(value, (*key, i), traps)
    elif isinstance(node, yaml.ScalarNode) and not node.style:
        for pattern, types in traps:
            if re.fullmatch(pattern, node.value) and re.fullmatch(types, _yaml_type(node)):
                yield key, _trap(node)


def _yaml_type(node):
    """Return the type of a node of YAML, such as ``str``."""
    return node.tag.rpartition(":")[2]


def _trap(node):
    """Return the fault of a value that YAML takes for another type than the user, text."""
    written, kind = node.value, _yaml_type(node)
    if kind == "str":
        mantissa, exponent = written.lower().split("e")
        whole = mantissa if "." in mantissa else f"{mantissa}.0"
        sign = "" if exponent[0] in "+-" else "+"
        return f"{written} is text to YAML, no number; write {whole}e{sign}{exponent}"
    meaning = yaml.safe_load(written)
    if kind == "float" and not math.isfinite(meaning):
        return f"{written} is no finite number"
    shown = str(meaning).lower() if kind == "bool" else meaning
    return f"{written} is {shown} to YAML; write '{written}' with quotes, or {shown}"


if __name__ == "__main__":
    # called before Snakemake reads the files, because its message does not name the line
    sys.exit("\n".join(filter(None, map(unreadable, sys.argv[1:]))) or 0)
