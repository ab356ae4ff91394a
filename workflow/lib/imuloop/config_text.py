"""Faults of a config's text: invalid YAML, and text that YAML reads otherwise than intended.

The latter are keys given twice, and values that YAML 1.1 takes for another type: 1e-3, on,
12:30:00, 007.
"""

import re
import sys

import yaml

from imuloop.core.errors import one_line

# the loader of libyaml, where it is installed, is much faster
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
# patterns for a value that YAML takes for another type: its type by YAML, a blank and its text
_TRAPS = (
    r"str [-+]?[0-9][0-9_]*(\.[0-9]*)?[eE][-+]?[0-9]+",
    r"(?i)bool (on|off|yes|no)",
    r"(int|float) [-+]?[0-9]+(:[0-9]+)+(\.[0-9]*)?",
    r"int [-+]?0[0-9_]+",
)
# pattern, of the same form, for further keys that YAML does not take for text
_NO_NAME = r"(?i)bool (true|false)|null .*"


def unreadable(path):
    """Return a line with the reason if the file at `path` does not hold a config, else None."""
    try:
        # if PyYAML reads the file, not its text, its message has the name with the line
        with open(path, encoding="utf-8") as file:
            content = yaml.safe_load(file)
    except FileNotFoundError:
        return f"{path}: there is no such file here; write one, or name one with --configfile"
    except Exception as error:
        # invalid YAML; text that is not UTF-8; an impossible date, number or truth value
        return one_line(f"{path}: cannot be read: {error}")
    if not isinstance(content, dict):
        kind = "empty" if content is None else "not a mapping of keys"
        return f"{path}: {kind}; it needs devices"
    return None


def read_keys(text):
    """Return two dicts by key of a config: the number of the key's line, and the fault of the key.

    The first has all keys, the second only keys with a fault. A key is the tuple of all names and
    indices that lead to a value. A fault is a text: the key is given twice, or YAML takes its name
    or value for another type than the user meant. `text` is the text of the config.
    """
    lines, faults, waiting = {}, {}, [((), yaml.compose(text, LOADER))]
    for key, node in waiting:
        pairs = node.value if isinstance(node, yaml.MappingNode) else ()
        for name, value in pairs:
            below, line = (*key, name.value), name.start_mark.line + 1
            if below in lines:
                faults[below] = f"given twice (again in line {line}); only one would count"
                continue
            if re.fullmatch(_NO_NAME, _typed(name)):
                faults[below] = f"'{name.value}' is not text to YAML; write it in quotes"
            lines[below] = line
            waiting += [(below, name), (below, value)]
        for i, value in enumerate(node.value if isinstance(node, yaml.SequenceNode) else ()):
            lines[*key, i] = value.start_mark.line + 1
            waiting.append(((*key, i), value))
        if isinstance(node, yaml.ScalarNode) and not node.style:
            if any(re.fullmatch(trap, _typed(node)) for trap in _TRAPS):
                faults[key] = _trap(node.value)
    return lines, faults


def _typed(node):
    """Return the type that YAML gives to a scalar, followed by its value: ``str 1e-3``.

    `node` is the scalar, a node of PyYAML.
    """
    return f"{node.tag.rpartition(':')[2]} {node.value}"


def _trap(written):
    """Return the fault, a text, of a value that YAML takes for another type than the user meant.

    `written` is the text of the value, such as 1e-3, which YAML takes for text.
    """
    meaning = yaml.safe_load(written)
    if isinstance(meaning, str):
        number, *_ = yaml.safe_dump(float(written)).split()
        return f"{written} is text to YAML, no number; write {number}"
    shown = str(meaning).lower() if isinstance(meaning, bool) else meaning
    return f"{written} is {shown} to YAML; write '{written}' with quotes, or {shown}"


if __name__ == "__main__":
    # called before Snakemake reads the files, because its message does not name the line
    sys.exit("\n".join(filter(None, map(unreadable, sys.argv[1:]))) or 0)
