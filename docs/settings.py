"""The config's schema and the table of its keys: ``make settings`` writes both from the models."""

import inspect
import re
from pathlib import Path

import yaml

from imuloop import config_files, config_model, config_session
from imuloop.config import STAGES

REPOSITORY = Path(__file__).resolve().parents[1]
SCHEMA = REPOSITORY / "workflow/schemas/config.schema.yaml"
TABLE = REPOSITORY / "docs/settings.md"
# models by name
MODELS = vars(config_files) | vars(config_session) | vars(config_model)
# keys of all logs of a device: as for a session
SHARED = ("format", "rate", "columns", "units")
HEAD = """# Keys of a config

Made by `make settings` from `workflow/lib/imuloop/config_*.py` and the stages' settings.
A key with – is needed. Limits: `workflow/schemas/config.schema.yaml`.
"""


def schema():
    """Return the JSON schema of a config as text, YAML."""
    content = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    content |= _plain(config_model.Config.model_json_schema())
    for name, model in [(None, content), *content["$defs"].items()]:
        _describe(model, MODELS[name or "Config"])
    options = {"sort_keys": False, "allow_unicode": True, "default_flow_style": None, "width": 100}
    return (
        f"# made by `make settings` from imuloop.config_model\n{yaml.safe_dump(content, **options)}"
    )


def _describe(schema, model):
    """Add the meanings of keys, from the Attributes in the docstring of their model, to a schema.

    Their units and limits are in the models of the stages' settings, which have no Attributes.
    """
    summary, _, text = inspect.cleandoc(model.__doc__).partition("\n\nAttributes\n----------\n")
    schema["description"] = summary
    for key, words in re.findall(r"^(\w+)\n((?: +.*\n?)+)", text, re.M):
        meaning = {"description": " ".join(words.split()).removesuffix(".")}
        schema["properties"][key] = meaning | schema["properties"][key]


def _plain(node):
    """Return a schema without titles, which are the keys again, and without defaults of None."""
    if isinstance(node, list):
        return [_plain(item) for item in node]
    if not isinstance(node, dict):
        return node
    plain = {}
    for key, value in node.items():
        if key in ("properties", "$defs"):
            plain[key] = {name: _plain(item) for name, item in value.items()}
        elif key != "title" and (key, value) != ("default", None):
            plain[key] = _plain(value)
    if "patternProperties" in plain:
        plain["additionalProperties"] = False
    return plain


def table(text):
    """Return the page of all keys, from the schema as text."""
    content = yaml.safe_load(text)
    defined = content["$defs"]
    device = {
        key: value for key, value in defined["Device"]["properties"].items() if key not in SHARED
    }
    parts = {
        "The config": content,
        "`devices.NAME`": defined["Device"] | {"properties": device},
        "`devices.NAME.sessions.NAME`": defined["Session"],
    }
    parts |= {f"`{stage}`": defined[f"{stage.title()}Settings"] for stage in STAGES}
    lines = [HEAD]
    for title, part in parts.items():
        lines += [f"## {title}\n", "|key|default|meaning|", "|---|---|---|"]
        lines += [*_rows(part, defined, {*()}), ""]
    return "\n".join(lines)


def _rows(node, defined, shown, prefix=""):
    """Yield the lines of a model's keys and of those below them, each model's once."""
    for key, value in node["properties"].items():
        models = [value, *value.get("oneOf", ()), value.get("items", {})]
        models = [option["$ref"].rpartition("/")[2] for option in models if "$ref" in option]
        meaning = value.get("description") or defined[models[0]]["description"].removesuffix(".")
        if "enum" in value:
            meaning += f": {', '.join(f'`{option}`' for option in value['enum'])}"
        default = "–" if key in node.get("required", ()) else _shown(value.get("default", ""))
        yield f"|`{prefix}{key}`|{default}|{meaning}|"
        for model in models:
            if model not in shown and not model.endswith("Settings"):
                shown.add(model)
                yield from _rows(defined[model], defined, shown, f"{prefix}{key}.")


def _shown(value):
    if isinstance(value, list):
        return ", ".join(map(_shown, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    SCHEMA.write_text(schema(), encoding="utf-8")
    TABLE.write_text(table(schema()), encoding="utf-8")
