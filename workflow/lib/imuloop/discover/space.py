"""The space of composed effects: made of what was logged, not listed."""

import re
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, combinations_with_replacement
from math import comb

import numpy as np

from imuloop.effects.axes import AXES
from imuloop.effects.discovered import Discovered
from imuloop.effects.temperature import LEAST_SPAN, span, whole_degrees

# degrees to which powers of a sensor's own output, and of the other's, go together
OWN, OTHER = 5, 3
# s; time constants of what settles after a turn: of the next cos² is 0.95
SETTLING = (3, 5, 8, 12, 20, 30)
# columns that are made at once: along the rotations a hundred are 100 MB
CHUNK = 90


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

    def kin(self, candidate, other):
        """Return whether two candidates differ by the time constants of what settles, or less."""
        return self._timeless(candidate) == self._timeless(other)

    def _timeless(self, candidate):
        return [re.sub(r"\bs\d+", "s", self.terms[c]) for c in self.candidates[candidate]]

    def complexity(self, candidate):
        """Return a candidate's, as of its effect."""
        return self.effect(self.candidates[candidate]).complexity

    def seen(self, rows):
        """Return the same space of some rows."""
        return replace(self, columns=self.columns[rows])

    def about(self, kelvin):
        """Return the same space with a reference temperature that is so much higher."""
        columns, place = self.columns.copy(), {term: k for k, term in enumerate(self.terms)}
        for k, lower in self.warm.items():
            for less, term in enumerate(lower, 1):
                # a constant is a bias, which is no column
                if term in place:
                    size = comb(len(lower), less) * (-kelvin) ** less
                    columns[:, k] += size * self.columns[:, place[term]]
        reference = self.reference_temperature + kelvin
        return replace(self, reference_temperature=reference, columns=columns)

    @cached_property
    def warm(self):
        """Of each column with a power of temperature, the terms of its lower powers, next first."""
        powers, found = ("", "T", "T^2", "T^3"), {}
        for k, term in enumerate(self.terms):
            axis, _, product = term.partition(": ")
            factors = product.split("*")
            for power, own in enumerate(powers):
                if own in factors:
                    lower = [[f if f != own else p for f in factors] for p in powers[:power][::-1]]
                    found[k] = [f"{axis}: {'*'.join(filter(None, each))}" for each in lower]
        return found


def monomials(letter, degree):
    """Return the products of powers of three components of one degree: ``fx^2*fy``."""
    found = []
    for axes in combinations_with_replacement(AXES, degree):
        powers = ((a, axes.count(a)) for a in dict.fromkeys(axes))
        found.append("*".join(f"{letter}{a}" + (f"^{p}" if p > 1 else "") for a, p in powers))
    return found


def groups(sensor, warm, vectors):
    """Return the factors of each group that products take one of, and all powers.

    Parameters
    ----------
    sensor : {'accelerometer', 'gyroscope'}
        Whose output.
    warm : bool
        Whether a temperature that changes was logged.
    vectors : str
        Letters of the outputs that change, of f and w: at rest nothing turns, and in one attitude
        neither does.
    """
    own, other = ("f", "w") if sensor == "accelerometer" else ("w", "f")
    factors = {
        "own": monomials(own, 1) if own in vectors else [],
        "other": monomials(other, 1) if other in vectors else [],
        "warmth": ["T", "T^2"] * warm,
        "rate": ["R"] * warm,
        "time": ["t"],
        "settling": [f"s{tau}" for tau in SETTLING],
        "turn": monomials("v", 1),
        "vibration": monomials("q", 1),
    }
    powers = [m for k in range(1, OWN + 1) for m in monomials(own, k) if factors["own"]]
    powers += [f"abs_{m}" for m in factors["own"]]
    powers += [m for k in range(1, OTHER + 1) for m in monomials(other, k) if factors["other"]]
    powers += ["T^3"] * warm + ["t^2"]
    return factors, powers


def formulas(sensor, warm, vectors):
    """Return all terms, ``x: fy^2*fz``, and candidates, as tuples of terms.

    Each product on each axis alone; and whole forms: one product on all axes; the same power of
    each axis' own component; all products of one degree of a vector, on all axes, times a scalar.
    """
    factors, powers = groups(sensor, warm, vectors)
    products = list(dict.fromkeys([*(f for own in factors.values() for f in own), *powers]))
    products += [
        f"{a}*{b}" for one, two in combinations(factors.values(), 2) for a in one for b in two
    ]
    own, other = ("f", "w") if sensor == "accelerometer" else ("w", "f")
    scalars = [*factors["warmth"], *["T^3"] * warm, *factors["rate"], *factors["time"]]
    scalars += factors["settling"]
    times = ["", *(f"*{s}" for s in scalars if s != "T^3")]
    forms = [[f"{a}: {s}" for a in AXES] for s in scalars]
    each = [f"{own}{{0}}^{k}" for k in range(2, OWN + 1)] + [f"abs_{own}{{0}}"]
    each += ["v{0}", "q{0}", *(f"{v}{{0}}{s}" for v in (own, other) for s in times)]
    forms += [[f"{a}: {one.format(a)}" for a in AXES] for one in each]
    whole = [monomials(own, 2), monomials(own, 3), monomials(other, 2), monomials(other, 3)]
    whole += [monomials("v", 1), monomials("q", 1)]
    whole += [[m + s for m in monomials(v, 1)] for v in (own, other) for s in times]
    forms += [[f"{a}: {m}" for a in AXES for m in each] for each in whole]
    # whatever the temperature is taken from
    each = ["", *(f"{m}*" for v in (own, other) for m in monomials(v, 1))]
    forms += [[f"{a}: {m}T", f"{a}: {m}T^2"] for a in AXES for m in each]
    forms += [[f"{a}: {m}{s}" for a in AXES for m in monomials(other, 1) for s in ("", "*T")]]
    terms = tuple(f"{a}: {m}" for m in products for a in AXES)
    known = set(terms)
    return terms, tuple((t,) for t in terms) + tuple(tuple(f) for f in forms if known >= set(f))


def space_of(sensor, channels, added, vectors):
    """Return the Space of a sensor.

    Takes the Channels of a record, what gives the derivative of its rows with respect to an
    effect's parameters, (N, p), and vectors as of `groups`.
    """
    warm = span(channels) > LEAST_SPAN
    reference = whole_degrees(channels) if warm else 25.0
    terms, candidates = formulas(sensor, warm, vectors)
    columns = [
        added(Discovered("; ".join(terms[i : i + CHUNK]), sensor, reference))
        for i in range(0, len(terms), CHUNK)
    ]
    place = {term: k for k, term in enumerate(terms)}
    numbers = tuple(tuple(place[t] for t in own) for own in candidates)
    return Space(sensor, reference, terms, np.hstack(columns), numbers)
