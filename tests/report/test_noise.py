"""The noise part: units, limits and the spectrum."""

import copy
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2

from imuloop.core.noise_model import AxisNoise
from imuloop.noise.spectrum import COLUMNS
from imuloop.report.figures.spectrum import density_pictures
from imuloop.report.results import SENSORS
from imuloop.report.tables.noise import coefficient_table
from imuloop.report.units import COEFFICIENTS
from report.plausible_results import RATE

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


def with_noise(device, **changes):
    return replace(device, noise={**copy.deepcopy(device.noise), **changes})


def test_every_coefficient_stands_in_the_units_of_data_sheets(board):
    table = coefficient_table(board, "accelerometer")
    # N of 8e-4 m/s²/√Hz, ± 2 %
    found = row_of(table, "N, white")
    assert found["Unit"] == "µg/√Hz" and found["x"].startswith("81.6 ±")
    assert [row[0][0] for row in table.rows] == [*COEFFICIENTS, "f"]
    # a coefficient that the record does not show has a limit
    for sensor in SENSORS:
        assert row_of(coefficient_table(board, sensor), "K, ")["z"].startswith("< ")


def test_chance_is_no_finding_and_a_true_departure_is(board, record):
    rng, edf = np.random.default_rng(0), 8
    model = AxisNoise.from_dict(board.noise["axes"]["gz"])
    f = np.geomspace(0.01, RATE / 4, 300)
    tables = []
    for axis in SENSORS["gyroscope"]:
        s = model.density(f, RATE) * rng.chisquare(edf, len(f)) / edf
        ends = (s * edf / chi2.ppf(p, edf) for p in (0.975, 0.025))
        tables.append((np.full(len(f), axis), f, s, *ends))
    columns = (np.concatenate(parts) for parts in zip(*tables, strict=True))
    spectra = pd.DataFrame(dict(zip(COLUMNS, columns, strict=True)))
    device = with_noise(board, axes={a: board.noise["axes"]["gz"] for a in board.noise["axes"]})
    (picture,) = density_pictures(device, replace(record, spectra=spectra))
    assert "keeps within 10\u202f% of the model" in picture.caption
    hump = (spectra["axis"] == "gy") & spectra["frequency_hz"].between(0.2, 0.5)
    spectra.loc[hump, ["psd", "ci_low", "ci_high"]] *= 3
    (picture,) = density_pictures(device, replace(record, spectra=spectra))
    found = re.search(
        r"most at ([\d.]+) to ([\d.]+)\u202fHz \(y\), with ([\d.]+) times", picture.caption
    )
    low, high, ratio = map(float, found.groups())
    assert 0.15 < low < high < 0.6 and ratio == pytest.approx(3, rel=0.4)


def test_what_a_noise_stage_did_not_do_is_left_out(devices):
    device = devices["partly"]
    assert not density_pictures(device, device.sessions[0])
