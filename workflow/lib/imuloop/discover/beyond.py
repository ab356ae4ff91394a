"""What the library of effects leaves of a record, searched; what is named goes into its results."""

from dataclasses import dataclass

import numpy as np

from imuloop.diagnose.choice import Choice, Choices
from imuloop.discover.discover import Discovery, discover
from imuloop.discover.searched import of_motion, of_poses, of_reference, of_static

# imitators that are listed
LISTED = 10
SEARCHED = {
    "poses": of_poses,
    "static_record": of_static,
    "motion": of_motion,
    "reference": of_reference,
}


class Composed(Choices):
    """Choices that are made: those of the library, and a formula, searched again for each part."""

    def __init__(self, problem, choices, effect, of_part, errors):
        super().__init__(problem)
        self.base = (*choices.choice().base, effect)
        self.library, self.of_part, self.known = choices, of_part, errors

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

    @property
    def content(self):
        """What diagnosis.json holds of the search."""
        space, found = self.discovery.space, self.discovery.found
        margin = min(found.margin, self.discovery.lead)

        def text(candidate):
            return "; ".join(space.terms[c] for c in space.candidates[candidate])

        status = "nothing"
        if found.candidates:
            status = "named" if self.choices else "structure"
        return {
            "status": status,
            "searched": len(space.candidates),
            "chance": found.chances[0] if found.chances else 1.0,
            "formula": "; ".join(space.terms[c] for c in found.columns),
            "margin": margin if np.isfinite(margin) else None,
            "left": self.discovery.left,
            "agreed": self.discovery.agreed,
            "constant": self.discovery.constant,
            "imitators": [text(k) for k in found.imitators[:LISTED]],
            "residuals": self.discovery.kinds,
            "points": self.discovery.shown,
        }

    def entry(self, fitted):
        """Return the entry of ``effects`` in diagnosis.json, of the FittedEffect."""
        kind = min(self.discovery.confirmed, key=lambda k: self.discovery.kinds[k]["ratio"])
        own = self.discovery.kinds[kind]
        return {
            **fitted.to_dict(),
            "units": fitted.effect.units(self.sensor),
            "p_value": self.discovery.found.chances[0],
            "residual": kind,
            "heldout_before": own["before"],
            "heldout_after": own["after"],
            "ratio_ci95": own["ratio_ci95"],
        }


def beyond(record, sensor, choices):
    """Return the Beyond of what a library's Choices leave of a sensor in a record.

    `record` is one of `SEARCHED`.
    """
    base = choices.choice().base
    searched = SEARCHED[record](choices.problem, base, sensor)
    discovery, problem = discover(searched), searched.problem
    effect = discovery.effect
    if effect is None or problem.lost((*base, effect)):
        return Beyond(sensor, discovery, None)
    of_part = [(discovery.space.effect(c),) if c else () for c in discovery.without]
    # at rest its rows are means over longer windows
    errors = discovery.errors[1] if record != "static_record" else None
    return Beyond(sensor, discovery, Composed(problem, choices, effect, of_part, errors))
