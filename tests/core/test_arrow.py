"""Arrow tables of arrays: what is read again is what was given, and pandas stays out."""

import os
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq

from imuloop.core.arrow import arrow_table
from imuloop.core.samples import read_columns


def test_columns_come_back_from_a_file(tmp_path):
    columns = {
        "x": np.array([1.5, np.nan, -2.0])[::-1],
        "n": np.array([3, 1, 2]),
        "text": np.array(["a", "größer", ""], dtype=object),
        "fixed": np.array(["raw", "corrected", "raw"]),
    }
    pq.write_table(arrow_table(columns), tmp_path / "t.parquet")
    found = read_columns(tmp_path / "t.parquet")
    assert list(found) == list(columns)
    for name in ("x", "n"):
        np.testing.assert_array_equal(found[name], columns[name])
        assert found[name].dtype == columns[name].dtype
    for name in ("text", "fixed"):
        assert found[name].tolist() == columns[name].tolist()
    empty = arrow_table({"x": np.zeros(0), "text": np.zeros(0, dtype=object)})
    assert empty.num_rows == 0 and str(empty.schema.field("text").type) == "large_string"


def test_writing_and_reading_load_no_pandas(tmp_path):
    code = (
        "import sys, numpy as np, pyarrow.parquet as pq\n"
        "from imuloop.core.arrow import arrow_table\n"
        "from imuloop.core.samples import read_columns\n"
        "path = sys.argv[1]\n"
        "pq.write_table(arrow_table({'x': np.arange(3.0), 's': np.array(['a', 'b', 'c'])}), path)\n"
        "assert len(read_columns(path)['s']) == 3\n"
        "assert 'pandas' not in sys.modules\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run(
        [sys.executable, "-c", code, tmp_path / "t.parquet"], check=True, env=environment
    )
