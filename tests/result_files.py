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
ALSO = dict.fromkeys(("six_position", "multi_position"), "calibration")


def fault(path):
    """Return the fault of a JSON file of results, ``results/<device>/….json``, or None."""
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
    resources = _resources()
    return Draft202012Validator(
        resources[name].contents, registry=Registry().with_resources(resources.items())
    )


@cache
def _resources():
    """Return the schemas by the names by which they call each other."""
    paths = SCHEMAS.glob("*.schema.yaml")
    return {p.name: Resource.from_contents(yaml.safe_load(p.read_text("utf-8"))) for p in paths}
