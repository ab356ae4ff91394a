"""The schemas describe every key, and find faults."""

import pytest
import yaml
from jsonschema import Draft202012Validator

from result_files import SCHEMAS

NAMES = sorted(path.name for path in SCHEMAS.glob("*.schema.yaml"))


@pytest.fixture(scope="module")
def schemas():
    return {name: yaml.safe_load((SCHEMAS / name).read_text(encoding="utf-8")) for name in NAMES}


def target(schemas, name, key):
    while "$ref" in key and "description" not in key:
        file, _, path = key["$ref"].partition("#/")
        name = file or name
        key = schemas[name]
        for part in path.split("/"):
            key = key[part]
    return key


def walk(node):
    if isinstance(node, dict):
        yield node
        for child in node.values():
            yield from walk(child)


@pytest.mark.parametrize("name", NAMES)
def test_a_schema_describes_every_key_and_allows_no_other(schemas, name):
    Draft202012Validator.check_schema(schemas[name])
    for node in walk(schemas[name]):
        for key, value in node.get("properties", {}).items():
            # a condition repeats a key
            if not set(value) <= {"const", "type", "minProperties"}:
                assert target(schemas, name, value).get("description"), key
        if "required" in node and "properties" in node:
            assert node.get("additionalProperties") is not None, node["required"]
