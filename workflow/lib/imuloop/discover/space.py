"""The space of composed effects: made of what was logged, not listed."""

import re
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, combinations, combinations_with_replacement
from math import comb

import numpy as np

from imuloop.effects.axes import AXES
from imuloop.effects.discovered import Discovered
from imuloop.effects.temperature import LEAST_SPAN, span, whole_degrees

# degrees to which powers of a sensor's own output, and of the other's, go together
OWN_DEGREE, OTHER_DEGREE = 5, 3
# s; time constants of what settles after a turn: of the next cos² is 0.95
SETTLING = (3, 5, 8, 12, 20, 30)
# columns that are made at once: along the rotations a hundred are 100 MB
CHUNK = 90
# powers of temperature in a term, and the next lower
LOWER = (("T^3", "T^2"), ("T^2", "T"), ("*T", ""), ("T*", ""), ("T", ""))


@dataclass(frozen=True)
class Space:
    """Composed effects of a sensor as the rows of a record see them."""

    sensor: str
    reference_temperature: float
    terms: tuple[str, ...]  # of each column, as of a formula
    columns: np.ndarray  # (N, k): what a coefficient of one adds to the rows
    candidates: tuple[tuple[int, ...], ...]  # columns of each candidate

    def effect(self, columns):
        """Return the effect that has some columns."""
        formula = "; ".join(self.terms[c] for c in columns)
        return Discovered(formula, self.sensor, self.reference_temperature)

    def kin(self, candidate):
        """Return the candidates that differ by the time constants of what settles, or less."""
        formulas = ("; ".join(self.terms[c] for c in own) for own in self.candidates)
        names = [re.sub(r"\bs\d+", "s", formula) for formula in formulas]
        return {k for k, name in enumerate(names) if name == names[candidate]}

    def warmer(self, kelvin):
        """Return the space with a reference temperature that is so much higher."""
        columns, reference = self.columns.copy(), self.reference_temperature + kelvin
        for k, lower in self.lower_powers.items():
            for less, column in enumerate(lower, 1):
                # a constant is a bias, which is no column
                if column is not None:
                    size = comb(len(lower), less) * (-kelvin) ** less
                    columns[:, k] += size * self.columns[:, column]
        return replace(self, reference_temperature=reference, columns=columns)

    @cached_property
    def lower_powers(self):
        """Of each column with a power of temperature those of lower powers, None for a constant."""
        place, found = {term: k for k, term in enumerate(self.terms)}, {}
        for k, term in enumerate(self.terms):
            while "T" in term:
                power, lower = next(pair for pair in LOWER if pair[0] in term)
                term = term.replace(power, lower)
                found.setdefault(k, []).append(place.get(term))
        return found


def monomials(letter, degree):
    """Return the products of powers of three components of one degree: ``fx^2*fy``."""
    found = []
    for axes in combinations_with_replacement(AXES, degree):
        powers = ((a, axes.count(a)) for a in dict.fromkeys(axes))
        found.append("*".join(f"{letter}{a}" + (f"^{p}" if p > 1 else "") for a, p in powers))
    return found


def formulas(sensor, warm, vectors):
    """Return all terms, ``x: fy^2*fz``, and candidates, as tuples of terms.

    Terms are powers, and products of one factor from each of two groups, on each axis. Candidates
    are single terms, and whole forms. `warm` is whether a temperature that changes was logged;
    `vectors` has the letters, of f and w, of outputs that change: in one attitude at rest neither.
    """
    own, other = "fw" if sensor == "accelerometer" else "wf"
    own_axes, other_axes = (monomials(v, 1) if v in vectors else [] for v in (own, other))
    temperature, rate = ["T", "T^2", "T^3"] * warm, ["R"] * warm
    settling, turn_and_vibration = [f"s{tau}" for tau in SETTLING], [monomials(v, 1) for v in "vq"]
    groups = [own_axes, other_axes, temperature[:2], rate, ["t"], settling, *turn_and_vibration]
    powers = [m for k in range(1, OWN_DEGREE + 1) for m in monomials(own, k) if own_axes]
    powers += [f"abs_{m}" for m in own_axes]
    powers += [m for k in range(1, OTHER_DEGREE + 1) for m in monomials(other, k) if other_axes]
    powers += [*temperature[2:], "t^2"]
    pairs = (f"{a}*{b}" for one, two in combinations(groups, 2) for a in one for b in two)
    terms = [f"{a}: {m}" for m in dict.fromkeys([*chain(*groups), *powers, *pairs]) for a in AXES]

    scalars = [*temperature, *rate, "t", *settling]
    times = ["", *(f"*{s}" for s in scalars if s != "T^3")]
    # one scalar on all axes
    forms = [[f"{a}: {s}" for a in AXES] for s in scalars]
    # the same of each axis' own component
    each = [f"{own}{{0}}^{k}" for k in range(2, OWN_DEGREE + 1)]
    each += [f"abs_{own}{{0}}", "v{0}", "q{0}"]
    each += [f"{v}{{0}}{s}" for v in (own, other) for s in times]
    forms += [[f"{a}: {m.format(a)}" for a in AXES] for m in each]
    # matrices: all products of one degree, on all axes
    each = [monomials(v, degree) for v in (own, other) for degree in (2, 3)] + turn_and_vibration
    each += [[m + s for m in monomials(v, 1)] for v in (own, other) for s in times]
    forms += [[f"{a}: {m}" for a in AXES for m in products] for products in each]
    # each axis' own component times another
    forms += [[f"{a}: {m}" for a in AXES for m in monomials(own, 2) if a in m and "^" not in m]]
    # polynomials in temperature, on one axis or as a matrix of the other sensor's output
    each = ["", *(f"{m}*" for v in (own, other) for m in monomials(v, 1))]
    forms += [[f"{a}: {m}T", f"{a}: {m}T^2"] for a in AXES for m in each]
    forms += [[f"{a}: {m}{s}" for a in AXES for m in monomials(other, 1) for s in ("", "*T")]]
    known = set(terms)
    return tuple(terms), tuple(tuple(f) for f in [*zip(terms), *forms] if known.issuperset(f))


def space_of(sensor, channels, added, vectors):
    """Return the Space of a sensor as Channels show it; `vectors` as of `formulas`.

    `added` gives the derivative of rows with respect to an effect's parameters, (N, p).
    """
    warm = span(channels) > LEAST_SPAN
    reference = whole_degrees(channels) if warm else 25.0
    terms, candidates = formulas(sensor, warm, vectors)
    parts = ("; ".join(terms[i : i + CHUNK]) for i in range(0, len(terms), CHUNK))
    columns = np.hstack([added(Discovered(part, sensor, reference)) for part in parts])
    place = {term: k for k, term in enumerate(terms)}
    numbers = tuple(tuple(place[t] for t in own) for own in candidates)
    return Space(sensor, reference, terms, columns, numbers)
