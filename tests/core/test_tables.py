"""Tables of all sessions of a device in one file."""

import numpy as np

from imuloop.core.tables import joined, read_session, table, write_sessions


def test_each_session_comes_back_from_the_table_of_all(tmp_path):
    path, names = tmp_path / "t.parquet", ("axis", "x")
    first, second = table(names, "ax", [1.0, 2.0]), table(names, "gy", [3.0])
    none = table(names, "", [])
    write_sessions(path, {"a": joined([first, second]), "b": none, "": none})
    found = read_session(path, "a")
    assert found["axis"].tolist() == ["ax", "ax", "gy"]
    np.testing.assert_array_equal(found["x"], [1.0, 2.0, 3.0])
    assert [len(column) for column in read_session(path, "b").values()] == [0, 0]
