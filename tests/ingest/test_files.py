"""Each row of `files.yaml`: a file as a logger writes it, and what its user gets."""

import json
import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import yaml

from imuloop.core.errors import ImuloopError
from ingest import array_forms, odd_forms, phone_forms, text_forms, vehicle_forms
from ingest.figures import check_figures
from ingest.harm import harmed
from ingest.logs import ALL

FORMS = (text_forms, array_forms, odd_forms, phone_forms, vehicle_forms)
CASES = yaml.safe_load(Path(__file__).with_name("files.yaml").read_text(encoding="utf-8"))
KEYS = {*"file log harm write each declared gives lost rounded within figures says".split()}
KEYS |= {"reason", "error", "held"}


def each_file():
    """Yield the row of each file, and the options of its writer, the file's name among them."""
    for name, case in CASES.items():
        choices = case.get("each", {})
        for values in product(*choices.values()):
            options = dict(zip(choices, values, strict=True))
            yield pytest.param(case, options, id=f"{name} {options or ''}")


def written(path, log, how, options):
    """Write the log of a row, and return the paths of its files."""
    name, defaults = (how, {}) if isinstance(how, str) else next(iter(how.items()))
    writer = next(getattr(forms, name) for forms in FORMS if hasattr(forms, name))
    content = writer(path, log, **defaults | options)
    if isinstance(content, str | bytes):
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        content = None
    return content if isinstance(content, list) else [content or path]


@pytest.mark.filterwarnings("error::pandas.errors.ParserWarning")
@pytest.mark.parametrize(("case", "options"), [*each_file()])
def test_a_file_gives_what_its_row_says(log, single, run, tmp_path, case, options):
    assert {*case} <= KEYS
    log = single if case.get("log") == "single" else log
    path = tmp_path / options.pop("file", case.get("file", "log.csv"))
    paths = written(path, harmed(log.copy(), case.get("harm", {})), case["write"], options)
    declared = case.get("declared", {})
    if "error" in case:
        with pytest.raises(ImuloopError, match=case["error"]) as caught:
            run(*paths, **declared)
        line = str(caught.value)
        assert line.startswith(f"imu/poses: {paths[0]}: ") and line.isprintable()
        assert not (tmp_path / "out").exists() and len(line) < 700
        return
    done = run(*paths, **declared)
    reasons, text = done.quality["reasons"], json.dumps(done.quality, ensure_ascii=False)
    assert (done.quality["status"] == "rejected") == ("reason" in case), reasons
    if "reason" in case:
        assert re.search(case["reason"], reasons[0]) and len(done.samples) == 0
        assert reasons[0].isprintable() and len(reasons[0]) < 400
        return
    if "held" in case:
        assert case["held"] <= len(done.samples) <= len(log)
        assert max(np.isin(done.samples[c], log[c]).mean() for c in ("ax", "gx")) == 1
        log = done.samples
    kept = harmed(log, case.get("gives", {})).drop(index=case.get("lost", []))
    rounded, within = case.get("rounded", 0.0), case.get("within", 1e-9)
    np.testing.assert_allclose(done.samples[ALL], kept[ALL], rtol=rounded, atol=rounded)
    times = kept.t - kept.t.iloc[0]
    np.testing.assert_allclose(done.samples.t, times, rtol=0, atol=within)
    check_figures(done.quality, case.get("figures", {}))
    assert [said for said in case.get("says", []) if said not in text.replace('\\"', '"')] == []


def test_dates_crop_and_missing_temperatures_stay_missing(log, run, tmp_path):
    array_forms.netcdf(tmp_path / "log.nc", log, day=0)
    done = run(tmp_path / "log.nc", time_range=["2021-09-20T08:53", "2021-09-20 08:56:00"])
    assert len(done.samples) == 180 and done.samples.t.iloc[-1] == 179
    assert done.metadata["start"] == "2021-09-20T08:53:00Z"
    assert done.quality["outside_time_range"] == 320
    done = run(tmp_path / "log.nc")
    np.testing.assert_array_equal(done.samples.temperature.isna(), log.index == 9)
