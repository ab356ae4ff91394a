"""Result files against their schemas, workflow/schemas."""

import json
from functools import cache
from pathlib import Path

import yaml
from jsonschema import Draft202012Validator
from jsonschema.exceptions import best_match
from referencing import Registry, Resource

SCHEMAS = Path(__file__).resolve().parents[1] / "workflow/schemas"
# these are a calibration each
ALSO = {"six_position": "calibration", "multi_position": "calibration"}


def fault(path):
    """Return what is wrong with a JSON file of results, or None.

    Parameters
    ----------
    path : Path
        ``results/<device>/….json``.
    """
    try:
        content = json.loads(path.read_text(), parse_constant=_no_number)
    except ValueError as error:
        return str(error)
    name = ALSO.get(path.stem, path.stem)
    error = best_match(validator(f"{name}.schema.yaml").iter_errors(content))
    return error and f"{error.json_path}: {error.message}"


def _no_number(text):
    raise ValueError(f"{text} is no JSON")


@cache
def validator(name):
    """Return the validator of a schema by its file's name."""
    return Draft202012Validator(_schemas()[name], registry=_registry())


@cache
def _schemas():
    paths = SCHEMAS.glob("*.schema.yaml")
    return {path.name: yaml.safe_load(path.read_text(encoding="utf-8")) for path in paths}


@cache
def _registry():
    """Return the schemas as they name each other."""
    made = ((name, Resource.from_contents(content)) for name, content in _schemas().items())
    return Registry().with_resources(made)
