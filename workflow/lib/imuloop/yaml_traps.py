"""What YAML 1.1 reads otherwise than it was written: keys given twice, 1e-3, on, 12:30:00, 007."""

import json
import math
import re

import yaml

# what is written, and what YAML takes it for
_TRAPS = (
    (r"[-+]?[0-9][0-9_]*(\.[0-9]*)?[eE][-+]?[0-9]+", "tag:yaml.org,2002:str"),
    (r"(?i)on|off|yes|no", "tag:yaml.org,2002:bool"),
    (r"[-+]?[0-9]+(:[0-9]+)+(\.[0-9]*)?", "tag:yaml.org,2002:(int|float)"),
    (r"[-+]?0[0-9_]+", "tag:yaml.org,2002:int"),
    (r"(?i)[-+]?\.(nan|inf)", "tag:yaml.org,2002:float"),
)
# a name that is none, beside those that are traps
_NO_NAME = r"(?i)tag:yaml\.org,2002:(bool (true|false)|null .*)"


def by_libyaml(function, text):
    """Return what `yaml.load` or `yaml.compose` makes of a text, where it can much faster."""
    try:
        return function(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except yaml.YAMLError:
        # refuses some escapes that the loader of Snakemake takes
        return function(text, yaml.SafeLoader)


def yaml_faults(text):
    """Return (key, fault) for each trap in a config's text, a key as a tuple of its parts."""
    node = by_libyaml(yaml.compose, text)
    return list(_faults(node, (), () if _is_json(text) else _TRAPS))


def _is_json(text):
    """Tell whether Snakemake reads a config as JSON, where a number is what it looks like."""
    try:
        json.loads(text)
    except ValueError:
        return False
    return True


def _faults(node, key, traps):
    """Yield what YAML would read otherwise than written, in a tree of nodes."""
    if isinstance(node, yaml.MappingNode):
        seen = set()
        for name, value in node.value:
            if name.value in seen:
                line = name.start_mark.line + 1
                yield (
                    (*key, name.value),
                    f"given twice (again in line {line}); only one would count",
                )
            seen.add(name.value)
            if traps and re.fullmatch(_NO_NAME, f"{name.tag} {name.value}"):
                yield (*key, name.value), f"'{name.value}' is no text to YAML; write it in quotes"
            yield from _faults(name, (*key, name.value), traps)
            yield from _faults(value, (*key, name.value), traps)
    elif isinstance(node, yaml.SequenceNode):
        for i, value in enumerate(node.value):
            yield from _faults(value, (*key, i), traps)
    elif isinstance(node, yaml.ScalarNode) and not node.style:
        for pattern, tag in traps:
            if re.fullmatch(pattern, node.value) and re.fullmatch(tag, node.tag):
                yield key, _trap(node)


def _trap(node):
    written, tag = node.value, node.tag.rpartition(":")[2]
    if tag == "str":
        mantissa, exponent = written.lower().split("e")
        whole = mantissa if "." in mantissa else f"{mantissa}.0"
        sign = "" if exponent[0] in "+-" else "+"
        return f"{written} is text to YAML, no number; write {whole}e{sign}{exponent}"
    meaning = yaml.safe_load(written)
    if tag == "float" and not math.isfinite(meaning):
        return f"{written} is no finite number"
    shown = str(meaning).lower() if tag == "bool" else meaning
    return f"{written} is {shown} to YAML; write '{written}' with quotes, or {shown}"
