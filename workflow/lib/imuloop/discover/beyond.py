"""What the library of effects leaves of a record, searched; what is named goes into its results."""

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError
from scipy.special import chdtrc

from imuloop.diagnose.choice import Choice, Choices
from imuloop.discover.discover import Discovery, discover
from imuloop.discover.pursuit import MARGIN, fitted
from imuloop.discover.searched import of_motion, of_poses, of_reference, of_static, rows_of

# imitators that are listed
LISTED = 10
# what becomes of an effect of the library that stood for a formula
GONE = {"status": "rejected", "why": "beside the formula that was found nothing of it is left"}
SEARCHED = {
    "poses": of_poses,
    "static_record": of_static,
    "motion": of_motion,
    "reference": of_reference,
}


class Composed(Choices):
    """Choices that are made: those of the library, and a formula, searched again for each part."""

    def __init__(self, problem, library, base, of_part, errors):
        super().__init__(problem)
        self.library, self.base, self.of_part, self.known = library, base, of_part, errors

    def choice(self, out=frozenset()):
        """Return the effects."""
        return Choice(self.base)

    def nested(self, out):
        """Return the effects that the library's search and this one add without a part."""
        (part,) = out
        return (*self.library.nested(out), *self.of_part[part])

    def errors(self, chosen, out=frozenset()):
        """Return those of the search with what each part's own chose, if it had all rows."""
        if chosen == self.nested and self.known is not None:
            return self.known[:, None]
        return super().errors(chosen, out)


@dataclass(frozen=True)
class Beyond:
    """What a search beyond the library found in a record of a sensor."""

    sensor: str
    discovery: Discovery
    choices: Composed | None  # with the formula; None where nothing was named
    imitators: tuple  # Discovered effects that would do as well, the best first

    @property
    def content(self):
        """What diagnosis.json holds of the search."""
        space, found = self.discovery.space, self.discovery.found
        margin = min(found.margin, self.discovery.lead)

        status, chosen = "nothing", space.effect(found.columns)
        if found.candidates:
            status = "named" if self.choices else "structure"
            chosen = self.choices.base[-1] if self.choices else chosen
        return {
            "status": status,
            "searched": len(space.candidates),
            "chance": found.chances[0] if found.chances else 1.0,
            "formula": chosen.formula,
            "margin": margin if np.isfinite(margin) else None,
            "left": self.discovery.left,
            "agreed": self.discovery.agreed,
            "constant": self.discovery.constant,
            "imitators": [effect.formula for effect in self.imitators[:LISTED]],
            "residuals": self.discovery.kinds,
            "points": self.discovery.shown,
        }

    def told_apart(self, misfit):
        """Return the same without imitators that other data tell from the formula, or it from them.

        `misfit` takes effects, the formula last, and gives χ² and reduced χ² of other data that
        depend on it; worse by `MARGIN`, χ² by that of the best, is none that would do as well. Of
        those that are left the lowest degree counts.
        """
        if not self.choices or not self.imitators:
            return self
        *base, formula = self.choices.base
        alike = (formula, *self.imitators[:LISTED])
        try:
            chi2, reduced = np.transpose([misfit((*base, effect)) for effect in alike])
        except LinAlgError:
            return self
        best = np.argmin(chi2)
        left = (chi2 - chi2[best]) / max(reduced[best], 1.0) < MARGIN
        near = [effect for effect, kept in zip(alike, left, strict=True) if kept]
        chosen = min(near, key=lambda e: e.degree)
        others = (e for e in near if e != chosen)
        choices = copy(self.choices)
        choices.base = (*base, chosen)
        return replace(self, choices=choices, imitators=tuple(others))

    def joined(self, effects, candidates, fitted):
        """Return ``effects`` and ``candidates`` of diagnosis.json with the formula.

        Takes those of the library and the FittedEffects with it, the formula's last: what the
        library took for it is no effect any more.
        """
        *known, formula = fitted
        own = {f.name: f.to_dict() for f in known}
        left = [e | own[e["name"]] for e in effects if e["name"] in own]
        gone = {e["name"] for e in effects} - set(own)
        changed = [c | GONE if c["name"] in gone else c for c in candidates]
        kind = min(self.discovery.confirmed, key=lambda k: self.discovery.kinds[k]["ratio"])
        gain = self.discovery.kinds[kind]
        entry = {
            **formula.to_dict(),
            "units": formula.effect.units(self.sensor),
            "p_value": self.discovery.found.chances[0],
            "residual": kind,
            "heldout_before": gain["before"],
            "heldout_after": gain["after"],
            "ratio_ci95": gain["ratio_ci95"],
        }
        return {"effects": [*left, entry], "candidates": changed}


def beyond(record, sensor, choices):
    """Return the Beyond of what a library's Choices leave of a sensor in a record.

    `record` is one of `SEARCHED`. None where the residuals determine no fit of a part.
    """
    try:
        return _searched(choices, SEARCHED[record](choices.problem, choices.choice().base, sensor))
    except LinAlgError:
        return None


def _searched(choices, searched):
    base, problem, sensor = choices.choice().base, searched.problem, searched.space.sensor
    discovery = discover(searched)
    effect, errors = discovery.effect, None
    space = discovery.space
    alike = tuple(space.effect(space.candidates[k]) for k in discovery.found.imitators)
    if effect is None or problem.lost((*base, effect)):
        return Beyond(sensor, discovery, None, alike)
    # errors of other rows are not those of the record
    if not searched.merged:
        errors, base = discovery.errors[1], needed(problem, base, effect)
    of_part = [(each,) if each.formula else () for each in discovery.without]
    composed = Composed(problem, choices, (*base, effect), of_part, errors)
    return Beyond(sensor, discovery, composed, alike)


def needed(problem, base, effect):
    """Return the effects of the library that a PoseProblem still shows beside a formula.

    Those stay whose parameters θ of covariance C have ``θᵀ C⁻¹ θ`` beyond chance, as the search of
    the library asks of them: others stood for what the formula says.
    """
    while base:
        rows, x = rows_of(problem, base), problem.linearized(base).solution.fit.x
        design = np.column_stack([rows.jacobian, problem.added(effect)[:, 0]])
        change, covariance = fitted(rows, design)
        start, chances = len(x) - sum(len(e.parameters) for e in base), []
        for each in base:
            at = slice(start, start + len(each.parameters))
            theta, start = x[at] + change[at], at.stop
            square = theta @ np.linalg.solve(covariance[at, at], theta)
            chances.append(chdtrc(len(theta), square))
        worst = int(np.argmax(chances))
        if chances[worst] < problem.settings.significance / problem.tests:
            break
        base = base[:worst] + base[worst + 1 :]
    return base
