"""Colours of the page: enough contrast, and those of a picture by itself."""

import re

import numpy as np
import pytest

from imuloop.report.figures.drawing import INK, THEME

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
TEXT = ("ink", "soft", "link", "good", "fair", "bad")


def _linear(colour):
    srgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _contrast(a, b):
    low, high = sorted(_linear(c) @ LUMINANCE + 0.05 for c in (a, b))
    return high / low


def _palettes(repository):
    parts = (repository / "workflow/templates/style.css").read_text().split("@media")
    return [dict(re.findall(r"--([\w-]+): (#\w{6})", part)) for part in parts[:2]]


@pytest.fixture(scope="module", params=["light", "dark"])
def colours(request, repository):
    light, dark = _palettes(repository)
    return light if request.param == "light" else light | dark


@pytest.mark.parametrize("ground", ["page", "panel"])
def test_text_has_a_contrast_of_4_5(colours, ground):
    poor = {name: _contrast(colours[name], colours[ground]) for name in TEXT}
    assert not {name: c for name, c in poor.items() if c < 4.5}


def test_lines_have_a_contrast_of_3(colours):
    lines = {f"c{i}": _contrast(colours[f"c{i}"], colours["page"]) for i in range(7)}
    assert not {name: c for name, c in lines.items() if c < 3}


def test_a_picture_without_the_page_has_its_light_colours(repository):
    light, _ = _palettes(repository)
    named = {colour: f"var(--{name})" for name, colour in light.items()}
    assert {colour: named[colour] for colour in THEME} | {INK: "currentColor"} == THEME
