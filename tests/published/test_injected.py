"""An effect put into a measured log at two detection limits is found, with the effects there."""

import numpy as np
import pyarrow as pa
import pytest

from bench.study.chain import run_stages
from imuloop.core.files import read_json
from published.measured import ingest_device
from published.test_stability import diagnose_change

NAME, LIMITS = "xsens_mti", 2.0


@pytest.fixture(scope="module")
def candidates(measured_results, tmp_path_factory):
    """Return the candidates at the poses of the gyroscope, with their limits."""
    measured_results.of(NAME)
    device = ingest_device(NAME, tmp_path_factory.mktemp("limits"))
    run_stages(device)
    return read_json(device.file("diagnosis.json"))["sensors"]["gyroscope"]["poses"]["candidates"]


@pytest.mark.study
@pytest.mark.parametrize(("name", "axis"), [("bias_drift", "x"), ("warm_up", "z")])
def test_what_changes_with_time_is_found(measured_results, candidates, tmp_path, name, axis):
    (candidate,) = (c for c in candidates if c["name"] == name)
    key = {"bias_drift": "d", "warm_up": "A"}[name] + axis
    size = LIMITS * candidate["detection_limit"][key]

    def put_in(table, segments):
        t = table["t"].to_numpy()
        tau = candidate["constants"].get("tau")
        added = size * (np.exp(-t / tau) if tau else t)
        columns = {c: table[c] for c in table.column_names}
        columns[f"g{axis}"] = pa.array(table[f"g{axis}"].to_numpy() + added)
        return pa.table(columns).replace_schema_metadata(table.schema.metadata)

    _, effects = diagnose_change(measured_results, NAME, tmp_path, put_in)["gyroscope"]
    assert {*effects} == {"g_sensitivity", name}
