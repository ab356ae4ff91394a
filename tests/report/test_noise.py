"""The noise part: units, limits and the spectrum."""

import pytest

from imuloop.report.figures.spectrum import density_pictures
from imuloop.report.results import SENSORS
from imuloop.report.tables.noise import coefficient_table
from imuloop.report.units import COEFFICIENTS

THIN = "\u202f"


@pytest.fixture
def board(devices):
    return devices["board"]


@pytest.fixture
def record(board):
    return board.sessions[0]


def row_of(table, start):
    (row,) = [r for r in table.rows if r[0].startswith(start)]
    cells = [cell.replace(THIN, " ") for cell in row]
    return dict(zip(table.columns, cells, strict=True))


def test_every_coefficient_stands_in_the_units_of_data_sheets(board):
    table = coefficient_table(board, "accelerometer")
    # N of 8e-4 m/s²/√Hz, ± 2 %
    found = row_of(table, "N, white")
    assert found["Unit"] == "µg/√Hz" and found["x"].startswith("81.6 ±")
    assert [row[0][0] for row in table.rows] == [*COEFFICIENTS, "f"]
    # a coefficient that the record does not show has a limit
    for sensor in SENSORS:
        assert row_of(coefficient_table(board, sensor), "K, ")["z"].startswith("< ")


def test_what_a_noise_stage_did_not_do_is_left_out(devices):
    device = devices["partly"]
    assert not density_pictures(device, device.sessions[0])
