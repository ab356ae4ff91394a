"""Jobs that have no need of pandas do not load it, those that have find it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import imuloop

BEGIN = """
import sys
import pyarrow as pa
from imuloop.without_pandas import hide_pandas
hide_pandas()
"""


def run(code):
    library = Path(imuloop.__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-c", BEGIN + code],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(library)},
    )
    assert not done.returncode, done.stderr
    return done.stdout.strip()


def test_an_array_is_converted_without_pandas():
    assert run("pa.array([1.0]).to_numpy(); print('pandas' in sys.modules)") == "False"


@pytest.mark.parametrize(
    "code",
    [
        "pa.table({'a': [1.0, None]}).to_pandas()",
        "pa.Table.from_pandas(__import__('pandas').DataFrame({'a': [1.0, float('nan')]}))",
    ],
)
def test_who_wants_pandas_has_it_as_ever(code):
    end = "pd = sys.modules['pandas']; print(pa.array(pd.Series([1.0, float('nan')])).null_count)"
    assert run(f"{code}; {end}") == "1"


def test_what_is_loaded_already_stays():
    code = "import pandas, sys; hide_pandas(); print(pandas.DataFrame({'a': ['x']}).to_dict())"
    assert run(code) == "{'a': {0: 'x'}}"
    assert run("print(len(sys.meta_path) == len(set(map(id, sys.meta_path))))") == "True"
