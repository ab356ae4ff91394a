"""Result files are whole or not there."""

import json

import numpy as np
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json, replaced, write_json
from imuloop.core.samples import Samples, read_columns, read_metadata, read_samples


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "r.json"
    write_json(path, {"a": 1})
    with pytest.raises(RuntimeError), replaced(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError("disk full")
    assert read_json(path) == {"a": 1}
    assert list(tmp_path.iterdir()) == [path]


def test_arrays_and_not_a_number_become_plain_json(tmp_path):
    write_json(tmp_path / "r.json", {"x": np.array([1.5, np.nan]), "n": np.int64(3)})
    assert json.loads((tmp_path / "r.json").read_text()) == {"x": [1.5, None], "n": 3}


def test_a_result_that_is_not_whole_is_named(tmp_path):
    path = tmp_path / "r.parquet"
    path.write_bytes(b"PAR1 and then nothing")
    for read in (read_samples, read_columns, read_metadata, Samples):
        with pytest.raises(ImuloopError, match=r"r\.parquet: no whole Parquet file; "):
            read(path)
