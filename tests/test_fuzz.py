"""The fuzzers of bench/fuzz: every harm can be done, and what goes wrong is seen."""

import random
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from bench.fuzz.harms import HARMS
from imuloop.core.samples import CHANNELS
from soundness import Page, read

WATCHED = """
import os, subprocess
from pathlib import Path
from bench.fuzz.conftest import Watch
watch = Watch()
os.mkdir("inside")
watch.folder = Path("inside").resolve()
Path("inside/log").write_text("")
Path("stray").write_text("")
subprocess.run(["true"])
watch.folder = None
print(*watch.outside, sep="\\n")
"""


@pytest.mark.parametrize("harm", HARMS)
def test_a_harm_changes_a_log_and_nothing_but_the_log(harm):
    rng = np.random.default_rng(0)
    log = pd.DataFrame(rng.normal(size=(600, 6)), columns=list(CHANNELS))
    log.insert(0, "t", np.arange(600) / 50)
    before = log.copy()
    harmed = [harm(log, random.Random(seed)) for seed in range(5)]
    assert all(set(log) <= set(one) for one in harmed)
    assert any(not one.equals(log) for one in harmed)
    pd.testing.assert_frame_equal(log, before)
    again = harm(log, random.Random(3))
    pd.testing.assert_frame_equal(again, harmed[3])


def test_what_a_case_does_elsewhere_is_seen(repository, tmp_path):
    path = {"PYTHONPATH": f"{repository}:{repository / 'workflow/lib'}"}
    command = [sys.executable, "-c", WATCHED]
    done = subprocess.run(command, cwd=tmp_path, env=path, capture_output=True, text=True)
    seen = done.stdout.splitlines()
    assert any(line == f"open {tmp_path}/stray" for line in seen), done.stderr
    assert any("subprocess.Popen" in line for line in seen)
    assert not any("inside" in line for line in seen)


def test_a_result_file_is_judged_by_its_schema_and_its_numbers(tmp_path):
    (tmp_path / "noise.json").write_text("{}")
    assert "is a required property" in next(read(tmp_path / "noise.json"))
    table = pd.DataFrame({"n": [1, 0], "ax_mean": [1.0, np.nan], "temperature_mean": [np.nan] * 2})
    for name, faults in (("segments", []), ("moves", ["ax_mean is not finite"])):
        table.to_parquet(tmp_path / f"{name}.parquet")
        assert [*read(tmp_path / f"{name}.parquet")] == faults
    assert [*read(tmp_path / "gone.json")] == ["missing"]


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("<p>1 to 2<br></p><td>none</td>", []),
        ("<p>ratio 1.0 to nan</p>", ["no number: ratio 1.0 to nan"]),
        ("<b><i></b>", ["</b> closes nothing", "left open: b"]),
        ('<path d="M0 nan"/>', ["d of path is M0 nan"]),
        ("<script>NaN</script>", []),
    ],
)
def test_a_page_is_judged_by_its_elements_and_words(text, faults):
    assert Page(text).faults == faults
