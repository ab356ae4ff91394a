"""The schemas describe every key, and have what the library has."""

import dataclasses
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator

import imuloop
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.units import ACCELERATION, ANGULAR_RATE, INCREMENTS, TEMPERATURE, TIME
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.ingest.formats import FORMATS
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.settings import SegmentSettings

SETTINGS = {
    "segment": SegmentSettings,
    "noise": NoiseSettings,
    "calibrate": CalibrateSettings,
    "diagnose": DiagnoseSettings,
}


SCHEMAS = Path(imuloop.__file__).parent / "schemas"


@pytest.fixture
def schema(repository):
    return yaml.safe_load((repository / "workflow/schemas/config.schema.yaml").read_text())


def walk(node):
    if isinstance(node, dict):
        yield node
        for child in node.values():
            yield from walk(child)


@pytest.mark.parametrize("name", ["config", "calibration"])
def test_schema_describes_every_key_and_gives_no_default(name):
    """As the installed package has it."""
    schema = yaml.safe_load((SCHEMAS / f"{name}.schema.yaml").read_text())
    Draft202012Validator.check_schema(schema)
    definitions = schema["$defs"]
    for node in walk(schema):
        assert "default" not in node
        for name, key in node.get("properties", {}).items():
            if isinstance(key, dict) and name != "$ref":
                target = definitions[key["$ref"].rpartition("/")[2]] if "$ref" in key else key
                assert key.get("description") or target.get("description"), name


@pytest.mark.parametrize("stage", SETTINGS)
def test_schema_has_the_settings_of_the_library(schema, stage):
    definition = schema["$defs"][stage]
    fields = [field.name for field in dataclasses.fields(SETTINGS[stage])]
    assert list(definition["properties"]) == fields


@pytest.mark.parametrize("stage", SETTINGS)
def test_schema_accepts_the_defaults_of_the_library(schema, stage):
    values = {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in dataclasses.asdict(SETTINGS[stage]()).items()
    }
    checked = {"$ref": f"#/$defs/{stage}", "$defs": schema["$defs"]}
    assert not list(Draft202012Validator(checked).iter_errors(values))


def test_schema_has_the_units_and_formats_of_the_library(schema):
    keys = schema["$defs"]["session"]["properties"]
    units = {name: set(key["enum"]) for name, key in keys["units"]["properties"].items()}
    assert units == {
        "time": {*TIME, "ISO 8601"},
        "acceleration": {*ACCELERATION, "count", *INCREMENTS["acceleration"]},
        "angular_rate": {*ANGULAR_RATE, "count", *INCREMENTS["angular_rate"]},
        "interval": set(TIME),
        "temperature": set(TEMPERATURE),
    }
    assert set(keys["format"]["enum"]) == set(FORMATS)
