"""The schema of the config has what the library has."""

import dataclasses

import pytest
import yaml
from jsonschema import Draft202012Validator

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


@pytest.fixture
def schema(repository):
    return yaml.safe_load((repository / "workflow/schemas/config.schema.yaml").read_text())


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


def test_a_calibration_may_be_in_any_unit_of_a_log(repository):
    content = (repository / "workflow/schemas/calibration.schema.yaml").read_text()
    units = yaml.safe_load(content)["$defs"]["sensor"]["properties"]["raw_unit"]["enum"]
    assert {*units} == {*ACCELERATION, *ANGULAR_RATE, "count"}
