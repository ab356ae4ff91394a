"""Keys of a config: files made from their models are current, and the models fit the library."""

import runpy

import pytest
import yaml
from pydantic import TypeAdapter

from imuloop.config_model import Device
from imuloop.core.units import ACCELERATION, ANGULAR_RATE

STAGES = ("segment", "noise", "calibrate", "diagnose")


def test_schema_and_table_are_those_of_the_models(repository):
    script = runpy.run_path(str(repository / "docs/settings.py"))
    schema = script["schema"]()
    assert script["SCHEMA"].read_text("utf-8") == schema, "make settings"
    assert script["TABLE"].read_text("utf-8") == script["table"](schema), "make settings"


@pytest.mark.parametrize("stage", STAGES)
def test_the_defaults_of_a_stage_are_within_its_limits(stage):
    settings = Device.model_fields[stage].annotation
    values = {key: getattr(settings(), key) for key in settings.__dataclass_fields__}
    assert TypeAdapter(settings).validate_python(values) == settings()


def test_a_calibration_may_be_in_any_unit_of_a_log(repository):
    content = (repository / "workflow/schemas/calibration.schema.yaml").read_text()
    units = yaml.safe_load(content)["$defs"]["sensor"]["properties"]["raw_unit"]["enum"]
    assert {*units} == {*ACCELERATION, *ANGULAR_RATE, "count"}
