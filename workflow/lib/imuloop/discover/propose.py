"""An effect file of a formula that was found: complete, for a physicist to name and explain."""

import re
from string import Template

from imuloop.core.errors import ImuloopError
from imuloop.effects.axes import AXES
from imuloop.effects.discovered import MEANINGS, Discovered

# where an effect shows, by the record
PATTERNS = {
    "poses": "the poses",
    "static_record": "the means at rest",
    "motion": "the velocity after a move",
    "reference": "the windows beside a reference",
}
FILE = Template('''\
"""$title, found in $device; what causes it is for you to say."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.discovered import Discovered

FORMULA = $formula


@dataclass(frozen=True)
class $cls(Effect):
    """``$equation``: found in $device by a search of composed effects.

$factors
    Found: $sizes.
    Held-out error: $errors.
    Leaves: its pattern in $pattern.
    Imitated by: $imitators.
    """

    reference_temperature: float = $reference

    name = "$name"
    sensors = ("$sensor",)
    parameters = {  # noqa: RUF012
$parameters    }
    equation = "$equation"
    reference = "found in $device; no physical reason is known yet"
    needs = $needs
    records = ("$record",)
    timed = $timed
    reach = $reach
    # ten times what was found
    limit = $limit

    def design(self, channels):
        """Return the derivative with respect to the coefficients, shape (n, 3, $count)."""
        composed = Discovered(FORMULA, "$sensor", self.reference_temperature)
        return np.asarray(composed.design(channels))
''')
TEST = Template('''\
"""The effect $name: its equation, and what injected data give back."""

import numpy as np

from imuloop.core.effect import Channels, FittedEffect, find_effect

VALUES = $values


def channels():
    rng, t = np.random.default_rng(0), 0.05 * np.arange(400)
    f, w = 9.8 * rng.uniform(-1, 1, (400, 3)), rng.uniform(-2, 2, (400, 3))
    own, other = $order
    return Channels(t, own, other, 20 + t), f, w


def test_it_is_its_equation():
    c, f, w = channels()
    effect = FittedEffect(find_effect("$name")(), VALUES, {})
    expected = np.zeros((400, 3))
$lines    np.testing.assert_allclose(effect.output(c), expected, rtol=1e-12, atol=1e-15)


def test_injected_data_give_its_parameters_back():
    c, _, _ = channels()
    effect = find_effect("$name")()
    design = effect.design(c).reshape(1200, -1)
    size = np.linalg.norm(design, axis=0)
    noise = 0.1 * np.random.default_rng(1).normal(size=1200)
    added = FittedEffect(effect, VALUES, {}).output(c).ravel()
    scale = np.linalg.norm(added) / np.linalg.norm(noise) / 10
    found = np.linalg.lstsq(design / size, added + scale * noise, rcond=None)[0] / size
    close = np.abs(found - list(VALUES.values())) * size
    assert np.all(close < 5 * scale * 0.1)
''')


def found_in(diagnosis):
    """Return sensor, record, entry of the effect and of its search.

    Raises an ImuloopError where none is named.
    """
    for sensor, records in diagnosis["sensors"].items():
        for record, block in records.items():
            for effect in block["effects"]:
                if effect["name"] == Discovered.name:
                    return sensor, record, effect, block["discovered"]
    raise ImuloopError(
        f"{diagnosis['device']}: no formula was found and named, so there is nothing to propose"
    )


def proposed(diagnosis, name):
    """Return the text of an effect file, and of its test.

    Parameters
    ----------
    diagnosis : dict
        Content of diagnosis.json.
    name : str
        Name of the new effect.

    Raises
    ------
    ImuloopError
        If the diagnosis names no formula, or the name is none.
    """
    sensor, record, entry, search = found_in(diagnosis)
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise ImuloopError(f"'{name}' is no name of an effect: small letters, digits and _")
    effect, device = Discovered(**entry["constants"]), re.sub(r"\W", "_", diagnosis["device"])
    letters, terms = sorted(effect.letters), effect.formula.split("; ")
    equation = "; ".join(
        f"e_{a} += {p} {product}"
        for p, (a, product) in zip(effect.parameters, (t.split(": ") for t in terms), strict=True)
    )
    if len(terms) > 3:
        equation = f"sum of {len(terms)} terms, see FORMULA"
    values = {k: float(v) for k, v in entry["parameters"].items()}
    sizes = [
        f"{k} = {v:.3g} ± {entry['std'][k]:.1g} {entry['units'][k]}" for k, v in values.items()
    ]
    meanings = (f"{x}: {MEANINGS[x]}" for x in letters)
    text = FILE.substitute(
        title=name.replace("_", " ").capitalize(),
        device=device,
        cls=name.title().replace("_", ""),
        name=name,
        sensor=sensor,
        record=record,
        pattern=PATTERNS[record],
        formula=_wrapped(terms),
        equation=equation,
        factors=_prose("Factors: " + "; ".join(meanings) + ".", effect),
        sizes=";\n    ".join(sizes),
        errors=";\n    ".join(
            f"{kind} {own['before']:.3g} before, {own['after']:.3g} after"
            for kind, own in search["residuals"].items()
        ),
        imitators=(",\n    ".join(search["imitators"]) or "nothing in the space that was searched"),
        reference=f"{effect.reference_temperature!r}",
        parameters="".join(f'        "{k}": "{u}",\n' for k, u in effect.parameters.items()),
        needs=repr(effect.needs).replace("'", '"'),
        timed=effect.timed,
        reach=effect.reach,
        limit=f"{10 * max(map(abs, values.values())):.1e}",
        count=len(terms),
    )
    return text, _test(name, sensor, effect, values)


def _wrapped(terms):
    if len(terms) < 4:
        return f'"{"; ".join(terms)}"'
    lines = [f'    "{t}{"; " if k < len(terms) - 1 else ""}"\n' for k, t in enumerate(terms)]
    return "(\n" + "".join(lines) + ")"


def _prose(text, effect):
    words, lines = text.format(reference_temperature=effect.reference_temperature).split(), ["   "]
    for word in words:
        if len(lines[-1]) + len(word) > 98:
            lines.append("   ")
        lines[-1] += f" {word}"
    return "\n".join(lines)


def _test(name, sensor, effect, values):
    """Return the test of an effect, its equation written out where no factor has a past."""
    lines = ""
    for key, (axis, factors) in zip(values, effect.terms, strict=True):
        product = " * ".join(_factor(*own, effect) for own in factors)
        lines += f'    expected[:, {axis}] += VALUES["{key}"] * {product}\n'
    if effect.timed:
        # what has a past has its own tests
        lines = "    expected = effect.effect.design(c) @ effect.vector\n"
    return TEST.substitute(
        name=name,
        values="{\n" + "".join(f'    "{k}": {v!r},\n' for k, v in values.items()) + "}",
        order="f, w" if sensor == "accelerometer" else "w, f",
        lines=lines,
    )


def _factor(name, power, absolute, effect):
    if name == "T":
        text = f"(c.temperature - {effect.reference_temperature!r})"
    else:
        text = f"{name[0]}[:, {AXES.index(name[1]) if name[1:] in tuple(AXES) else 0}]"
    text = f"np.abs({text})" if absolute else text
    return f"{text}**{power}" if power > 1 else text
