"""The noise part: units, limits, the check by the curve fit, spectrum and other definitions."""

import copy
import re
from dataclasses import asdict, replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2

from imuloop.core.noise_model import AxisNoise
from imuloop.noise.views import COLUMNS, DEFINITIONS, power_spectrum
from imuloop.report.figures.allan import definitions, deviation_pictures
from imuloop.report.figures.spectrum import correlation_pictures, density_pictures
from imuloop.report.results import SENSORS
from imuloop.report.tables.noise import coefficient_table, stability_table, uncut_table
from imuloop.report.units import COEFFICIENTS, quantities
from report.plausible_noise import DISTURBED, known
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


def test_units_per_sample_are_those_of_simulated_samples():
    rng, rate = np.random.default_rng(5), 50.0
    count, factor = 200_000, {k: q.sample.factor for k, q in quantities("gyroscope", rate).items()}
    quantised = np.diff(0.3 * rng.standard_normal(count)) * rate
    assert quantised.std() == pytest.approx(0.3 * factor["Q"], rel=0.01)
    # N: the mean over 10 s scatters by N / sqrt(10 s)
    white = factor["N"] * rng.standard_normal(count)
    means = white[: count // int(10 * rate) * int(10 * rate)].reshape(-1, int(10 * rate)).mean(1)
    assert means.std() == pytest.approx(1 / np.sqrt(10), rel=4 / np.sqrt(2 * len(means)))
    # K: over 10 s a walk goes K sqrt(10 s) far
    steps = factor["K"] * rng.standard_normal(count)
    ways = steps[: count // int(10 * rate) * int(10 * rate)].reshape(-1, int(10 * rate)).sum(1)
    assert ways.std() == pytest.approx(np.sqrt(10), rel=4 / np.sqrt(2 * len(ways)))
    # R: after a second of such steps the output has moved by R; B and an amplitude stay
    assert factor["R"] * rate == pytest.approx(1)
    assert factor["B"] == factor["amplitude"] == 1
    assert factor["frequency"] == pytest.approx(1 / rate) and factor["tc"] == rate


def test_every_coefficient_stands_in_three_systems_with_their_units(board):
    table = coefficient_table(board, "accelerometer")
    si, sample = "SI, continuous time", "Per sample at 20 Hz, discrete"
    units, found = row_of(table, "N, white"), row_of(table, "N, x")
    assert (units[si], units["Data sheet"]) == ("m/s²/√Hz", "µg/√Hz\nm/s/√h")
    assert units[sample] == "m/s², σ of a sample"
    # N of 8e-4 m/s²/√Hz, ± 2 %, at 20 Hz
    assert found[si].startswith("(8.00 ±") and found["Data sheet"].startswith("81.6 ±")
    assert found[sample].startswith("0.003578")
    assert [table.rows[i][0][0] for i in table.heads] == [*COEFFICIENTS, "Ω", "f"]
    # the plain fit stands beside as a check; what leaves it is named
    assert row_of(table, "K, x")["Allan-curve fit, a check only"] == "not in the fit"
    assert table.note.endswith("it leaves their interval or limit at N of y.")
    assert row_of(table, "Ω, z")["Remark"] == "50 Hz mains, alias of its 2nd harmonic"
    # q sqrt(T/2) = 2e-5 sqrt(15) rad/s = 16.0 deg/h
    hump = row_of(coefficient_table(board, "gyroscope"), "q, x")
    assert hump["Remark"].endswith("16.0 °/h")


def test_what_the_record_does_not_show_has_a_limit_and_the_record_it_would_take(board):
    for sensor in SENSORS:
        found = row_of(coefficient_table(board, sensor), "K, z")
        values = [found[c] for c in list(found)[1:4]]
        assert all(v.startswith("< ") for v in values)
        assert found["95 % interval"] == "—"
        assert found["Remark"] == "needs a record of about 40 h"
    assert row_of(coefficient_table(board, "gyroscope"), "N, z")["Remark"] == ""


def test_what_a_disturbance_would_have_done_is_said(board):
    table = uncut_table(board, "gyroscope")
    axis, _, value = DISTURBED
    found = row_of(table, f"K, {axis[1]}")
    assert found["Cut (used)"].startswith("<")
    assert found["Changed by"] == f"> {value / 3e-6:.0f} ×"
    assert "6.00 s of disturbed record were cut" in table.note.replace(THIN, " ")
    assert "Left in, K of y would be read as" in table.note
    # what neither shows is no finding
    assert not [r for r in table.rows if r[0].startswith("R")]


def test_four_definitions_of_bias_stability_are_told_apart(board):
    table = stability_table(board, "gyroscope")
    names = [r[0] for r in table.rows]
    assert [n[0] for n in names] == ["1", "2", "2", "3", "4"]
    run = row_of(table, "3. Run")
    assert "3 sessions" in run["Definition"]
    # 2e-4 rad/s in deg/h
    assert run["x"].split("\n") == ["2.00 × 10⁻⁴", "41.3"]
    # no accelerometer figure: the attitudes differ
    run = row_of(stability_table(board, "accelerometer"), "3. Run")
    assert run["x"] == "—" and "same attitude" in run["Definition"]


def test_a_ramp_is_drawn_as_the_spectrum_shows_it(board, record):
    count, slope = 200_000, 1e-6
    f, s, _ = power_spectrum([0.3 + slope * np.arange(count) / RATE], RATE)
    names = (np.full(len(f), name) for name in ("psd", "gy"))
    views = pd.DataFrame(dict(zip(COLUMNS, (*names, f, s, 0.9 * s, 1.1 * s), strict=True)))
    axes = copy.deepcopy(board.noise["axes"])
    axes["gy"].update(dict.fromkeys("QNBK", axes["gy"]["K"]), R=asdict(known(slope)))
    device = with_noise(board, axes=axes)
    density_pictures(device, replace(record, views=views))
    rows = pd.read_csv(board.figures / "long_psd.csv")
    assert rows["model"][:6].to_numpy() == pytest.approx(rows["psd"][:6], rel=1e-6)
    assert rows[["model", "psd"]][40:].max().max() < 1e-7 * rows["psd"][0]


def test_chance_is_no_finding_and_a_true_departure_is(board, record):
    rng, edf = np.random.default_rng(0), 8
    model = AxisNoise.from_dict(board.noise["axes"]["gz"])
    f = np.geomspace(0.01, RATE / 4, 300)
    tables = []
    for axis in SENSORS["gyroscope"]:
        s = model.density(f, RATE) * rng.chisquare(edf, len(f)) / edf
        ends = (s * edf / chi2.ppf(p, edf) for p in (0.975, 0.025))
        names = (np.full(len(f), name) for name in ("psd", axis))
        tables.append((*names, f, s, *ends))
    columns = (np.concatenate(parts) for parts in zip(*tables, strict=True))
    views = pd.DataFrame(dict(zip(COLUMNS, columns, strict=True)))
    device = with_noise(board, axes={a: board.noise["axes"]["gz"] for a in board.noise["axes"]})
    (picture,) = density_pictures(device, replace(record, views=views))
    assert "keeps within 10\u202f% of the model" in picture.caption
    hump = (views["axis"] == "gy") & views["x"].between(0.2, 0.5)
    views.loc[hump, ["value", "ci_low", "ci_high"]] *= 3
    (picture,) = density_pictures(device, replace(record, views=views))
    found = re.search(
        r"most at ([\d.]+) to ([\d.]+)\u202fHz \(y\), with ([\d.]+) times", picture.caption
    )
    low, high, ratio = map(float, found.groups())
    assert 0.15 < low < high < 0.6 and ratio == pytest.approx(3, rel=0.4)


def test_each_deviation_has_its_own_name_and_autocorrelation_ends_where_chance_does(board, record):
    caption = deviation_pictures(board, record)[0].caption
    for words in ("Allan", "Total", "Modified Allan", "Hadamard"):
        assert words in caption
    assert definitions(board) == [DEFINITIONS[n] for n in ("total", "modified", "hadamard")]
    # 0.5**lag stays above 0.03 for five lags
    caption = correlation_pictures(board, record)[0].caption.replace(THIN, " ")
    assert "0.50, 0.50, 0.50 from a sample" in caption and "up to 0.250 s" in caption


def test_what_a_noise_stage_did_not_do_is_left_out(devices):
    device = devices["partly"]
    table = coefficient_table(device, "accelerometer")
    assert "Per sample, rate not known" in table.columns
    assert not [c for c in table.columns if "fit" in c]
    assert uncut_table(device, "accelerometer") is None
    assert not density_pictures(device, device.sessions[0])
    assert not deviation_pictures(device, device.sessions[0])
