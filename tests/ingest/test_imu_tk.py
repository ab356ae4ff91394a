"""imu_tk's two files."""

import numpy as np
import pytest

from imuloop.core.errors import ImuloopError


@pytest.fixture
def pair(log, tmp_path):
    paths = [tmp_path / "acc.mat", tmp_path / "gyro.mat"]
    for path, names in zip(paths, ["ax ay az", "gx gy gz"], strict=True):
        np.savetxt(path, log[["t", *names.split()]], fmt="   %.7e")
    return paths


@pytest.mark.parametrize("form", ["%.7e", "%r"])
def test_every_bit(hard, every_bit, tmp_path, form):
    t = 1e9 + np.arange(300) / 100
    paths = {"acceleration": tmp_path / "acc.mat", "angular_rate": tmp_path / "gyro.mat"}
    for path, three in zip(paths.values(), (hard[:, :3], hard[:, 3:]), strict=True):
        rows = np.column_stack([t, three]).tolist()
        path.write_text("".join(" ".join(form % x for x in row) + "\n" for row in rows))
    nearest = np.array([[float(form % x) for x in row] for row in hard.tolist()])
    every_bit(paths, nearest, np.array([float(form % x) for x in t.tolist()]))


@pytest.mark.parametrize(("rows", "late"), [(497, 0.0), (500, 0.001)])
def test_rows_and_clocks_may_differ(log, run, pair, rows, late):
    gyroscope = log[["t", "gx", "gy", "gz"]] + [late, 0, 0, 0]
    np.savetxt(pair[1], gyroscope[:rows], fmt="%.7e")
    done = run(*pair, batch_rows=40)
    assert done.quality["status"] == "ok"
    assert 490 < len(done.samples) <= 500


def test_other_widths_need_columns(log, run, pair):
    np.savetxt(pair[1], log, fmt="%.7e")
    with pytest.raises(ImuloopError, match=r"columns of angular_rate found \(no header, 7 columns"):
        run(*pair)
    columns = {"acceleration": [1, 2, 3], "angular_rate": [4, 5, 6], "time": 0}
    np.testing.assert_allclose(run(*pair, columns=columns).samples.gz, log.gz, rtol=1e-6)
    with pytest.raises(ImuloopError, match="imu_tk is read from acceleration and angular_rate"):
        run(pair[0], format="imu_tk")


def test_units_of_a_header(log, run, pair):
    plain = [path.read_text() for path in pair]
    for heads, reported in (
        (("t[ms] x[g] y[g] z[g]\n", "t[ms] x[dps] y[dps] z[dps]\n"), None),
        (
            ("t x[furlong] y[furlong] z[furlong]\n", ""),
            r"units\.acceleration: the log says 'furlong'",
        ),
    ):
        for path, head, rows in zip(pair, heads, plain, strict=True):
            path.write_text(head + rows)
        if reported:
            with pytest.raises(ImuloopError, match=reported):
                run(*pair)
            continue
        units = run(*pair).metadata["units"]
        assert units == {"time": "ms", "acceleration": "g", "angular_rate": "deg/s"}
    pair[0].write_text("t[ms] x y z\n" + plain[0])
    [reason] = run(*pair).quality["reasons"]
    assert "share no time: their clocks differ" in reason
