"""Colours of the page: enough contrast, and told apart with any colour vision."""

import re
from itertools import combinations

import numpy as np
import pytest

from imuloop.report.figures.drawing import INK, THEME

# severe deficiency: Machado, Oliveira and Fernandes (2009), linear RGB
DEFICIENCIES = {
    "none": np.eye(3),
    "protan": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deutan": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritan": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
TEXT = ("ink", "soft", "link", "good", "fair", "bad")


def _linear(colour):
    srgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _contrast(a, b):
    low, high = sorted(_linear(c) @ LUMINANCE + 0.05 for c in (a, b))
    return high / low


def _oklab(linear):
    lms = np.cbrt(
        np.clip(linear, 0, None)
        @ np.array(
            [
                [0.4122214708, 0.2119034982, 0.0883024619],
                [0.5363325363, 0.6806995451, 0.2817188376],
                [0.0514459929, 0.1073969566, 0.6299787005],
            ]
        )
    )
    return lms @ np.array(
        [
            [0.2104542553, 1.9779984951, 0.0259040371],
            [0.7936177850, -2.4285922050, 0.7827717662],
            [-0.0040720468, 0.4505937099, -0.8086757660],
        ]
    )


def _palettes(repository):
    """Return the colours of the page, light ones first, dark ones where they differ."""
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


@pytest.mark.parametrize("deficiency", DEFICIENCIES)
@pytest.mark.parametrize("count", [3, 7])
def test_colours_are_told_apart(colours, deficiency, count):
    """Three colours are the axes; seven are devices, whose lines also differ in place."""
    seen = [
        _oklab(np.array(DEFICIENCIES[deficiency]) @ _linear(colours[f"c{i}"])) for i in range(count)
    ]
    close = {(i, j): np.linalg.norm(seen[i] - seen[j]) for i, j in combinations(range(count), 2)}
    assert min(close.values()) > (0.1 if count == 3 else 0.04), min(
        close.items(), key=lambda c: c[1]
    )


def test_a_picture_without_the_page_has_its_light_colours(repository):
    light, _ = _palettes(repository)
    named = {colour: f"var(--{name})" for name, colour in light.items()}
    assert {colour: named[colour] for colour in THEME} | {INK: "currentColor"} == THEME
