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


def test_different_row_counts_are_rejected(run, pair):
    lines = pair[1].read_text().splitlines(keepends=True)
    pair[1].write_text("".join(lines[:-3]))
    done = run(*pair, batch_rows=40)
    assert done.quality["status"] == "rejected"
    assert "acceleration file has 500 rows, the angular rate file 497" in done.quality["reasons"][0]
    assert len(done.samples) == 0


def test_different_clocks_are_rejected(log, run, pair):
    np.savetxt(pair[1], log[["t", "gx", "gy", "gz"]] + [0.001, 0, 0, 0], fmt="%.7e")
    done = run(*pair)
    assert done.quality["status"] == "rejected"
    assert (
        "row 0: the acceleration is stamped 0.0, the angular rate 0.001"
        in (done.quality["reasons"][0])
    )


def test_declared_columns_and_other_widths_are_refused(log, run, pair):
    with pytest.raises(ImuloopError, match="fixed columns"):
        run(*pair, columns={"time": 0})
    np.savetxt(pair[1], log, fmt="%.7e")
    with pytest.raises(ImuloopError, match="four columns t x y z, this one has 7"):
        run(*pair)
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
    assert run(*pair).quality["reasons"] == ["the two files state different units of time"]
