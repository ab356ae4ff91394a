"""The validation by attitude in the report: the sentence, the table, a line a stretch and model."""

from types import SimpleNamespace

import pandas as pd
import pytest

from imuloop.core.files import write_json
from imuloop.report.attitude_plot import attitude_part

RMS = {"raw": 12.7, "base": 0.556, "final": 0.154}


def attitude(rms):
    """Return what attitude.json and attitude.parquet hold for errors of this size."""
    method = {
        "n": 4,
        "duration_s": 2.1,
        "models": {
            m: {"rms_deg": e, "median_deg": 0.9 * e, "p95_deg": 2 * e} for m, e in rms.items()
        },
        "base_over_final": rms["base"] / rms["final"],
        "ratio_ci95": [0.9 * rms["base"] / rms["final"], 1.1 * rms["base"] / rms["final"]],
    }
    methods = {m: dict(method) for m in ("rotation", "stretch", "mahony")}
    methods["rotation"]["floor_deg"] = 0.123
    rows = [
        ("turns", stretch, stretch, m, model, 10.0 * stretch + t, 2.0 * t, "arrival", e)
        for m in methods
        for stretch in (0, 1)
        for model, e in rms.items()
        for t in (1, 2, 3)
    ]
    columns = "session stretch block method model t_s after_s at error_deg".split()
    content = {"status": "ok", "gains": {"k_P": 1.0, "k_I": 0.3}, "methods": methods}
    return content, pd.DataFrame(rows, columns=columns)


@pytest.fixture
def part(tmp_path):
    def build(content, series=None):
        folder = tmp_path / "board"
        (folder / "figures").mkdir(parents=True)
        write_json(folder / "attitude.json", content)
        if series is not None:
            series.to_parquet(folder / "attitude.parquet")
        device = SimpleNamespace(name="board", folder=folder)
        return attitude_part(device, folder / "figures"), folder / "figures"

    return build


def test_the_finding_is_made_of_the_numbers(part):
    found, figures = part(*attitude(RMS))
    assert "one rotation of 2.1\u202fs" in found["finding"]
    for text in ("13° as logged", "0.56° with the base", "0.15° with the final", "final 3.61"):
        assert text in found["finding"]
    ((table,), pictures) = found["tables"], found["pictures"]
    assert [len(row) for row in table.rows] == [len(table.columns)] * 3
    assert table.rows[0][3:6] == ("13 (25)", "0.56 (1.1)", "0.15 (0.31)")
    assert [p.name for p in pictures] == ["board.attitude_stretch", "board.attitude_mahony"]
    for picture in pictures:
        # three models of two stretches, and their marks
        assert picture.svg.count("<path") >= 6
        assert all(text in picture.caption for text in ("13°", "0.56°", "0.15°"))
    assert len(pd.read_csv(figures / "attitude_stretch.csv")) == 18


def test_a_final_model_that_is_the_base_model_is_told_as_one(part):
    found, _ = part(*attitude(RMS | {"final": RMS["base"]}))
    assert "the final model is the same" in found["finding"]
    assert all("also the final one" in p.svg for p in found["pictures"])


def test_without_a_validation_the_reason_stands_there(part, tmp_path):
    found, _ = part({"status": "not_testable", "why": "no <pose>"})
    assert found["finding"] == "The error of the vertical cannot be tested: no <pose>."
    assert not found["tables"] and not found["pictures"]
    nothing = attitude_part(SimpleNamespace(name="x", folder=tmp_path / "none"), tmp_path)
    assert nothing == {"finding": "", "tables": [], "pictures": []}
