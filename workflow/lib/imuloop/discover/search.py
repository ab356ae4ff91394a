"""What the library of effects leaves of a record, searched; what is named goes into its results."""

from dataclasses import dataclass

from scipy.linalg import LinAlgError

from imuloop.diagnose.choice import Choice, Choices
from imuloop.discover.discovery import Discovery, discover
from imuloop.discover.search_input import INPUTS, still_needed

# imitators that are listed
LISTED = 10
# what becomes of an effect of the library that stood for a formula
GONE = {"status": "rejected", "why": "beside the formula that was found nothing of it is left"}


class FormulaModel(Choices):
    """Choices that are made: those of the library, and a formula, searched again for each part."""

    def __init__(self, problem, library, base, part_effects, heldout):
        super().__init__(problem)
        self.library, self.base = library, base
        self.part_effects, self.heldout = part_effects, heldout

    def choice(self, held_out=frozenset()):
        """Return the effects."""
        return Choice(self.base)

    def nested(self, held_out):
        """Return the effects that the library's search and this one add without a part."""
        (part,) = held_out
        own = self.part_effects[part]
        return (*self.library.nested(held_out), *([own] if own.formula else []))

    def errors(self, chosen, held_out=frozenset()):
        """Return the held-out errors with what is chosen, (N, 1): known of the search's own."""
        if chosen == self.nested and self.heldout is not None:
            return self.heldout[:, None]
        return super().errors(chosen, held_out)


@dataclass(frozen=True)
class FormulaSearch:
    """What a search beyond the library found in a record of a sensor."""

    discovery: Discovery
    choices: FormulaModel | None  # with the formula; None where nothing was named
    imitators: tuple  # Discovered effects that would do as well, the best first

    @property
    def content(self):
        """What diagnosis.json holds of the search."""
        found, space, selection = self.discovery, self.discovery.space, self.discovery.selection
        status = "structure" if selection.candidates else "nothing"
        formula = self.choices.base[-1] if self.choices else space.effect(selection.columns)
        return {
            "status": "named" if self.choices else status,
            "searched": len(space.candidates),
            "chance": selection.chance,
            "formula": formula.formula,
            "imitators": [effect.formula for effect in self.imitators[:LISTED]],
            "residuals": found.kinds,
            "points": found.points,
        }

    def joined(self, effects, candidates, fitted):
        """Return ``effects`` and ``candidates`` of diagnosis.json with the formula.

        Takes those of the library and the FittedEffects with it, the formula's last: what the
        library took for it is no effect any more.
        """
        *library, formula = fitted
        still = {f.name: f.to_dict() for f in library}
        kept = [e | still[e["name"]] for e in effects if e["name"] in still]
        gone = {e["name"] for e in effects} - set(still)
        kinds = self.discovery.kinds
        kind = min(self.discovery.confirmed, key=lambda k: kinds[k]["ratio"])
        entry = {
            **formula.to_dict(),
            "units": formula.effect.units(self.discovery.space.sensor),
            "p_value": self.discovery.selection.chance,
            "residual": kind,
            "heldout_before": kinds[kind]["before"],
            "heldout_after": kinds[kind]["after"],
            "ratio_ci95": kinds[kind]["ratio_ci95"],
        }
        changed = [c | GONE if c["name"] in gone else c for c in candidates]
        return {"effects": [*kept, entry], "candidates": changed}


def search_formulas(record, sensor, choices):
    """Return the FormulaSearch of what a library's Choices leave of a sensor in a record.

    `record` is one of `INPUTS`. None where the residuals determine no fit without a part.
    """
    base = choices.choice().base
    try:
        searched = INPUTS[record](choices.problem, base, sensor)
        found, problem = discover(searched), searched.problem
        effect, space = found.effect and searched.named(found.effect), found.space
        imitators = tuple(space.effect(space.candidates[k]) for k in found.selection.imitators)
        if effect is None or problem.rejection_reason((*base, effect)):
            return FormulaSearch(found, None, imitators)
        # errors of other rows are not those of the record
        heldout = None if searched.test else found.heldout
        base = base if searched.test else still_needed(problem, base, effect)
        part_effects = [searched.named(own) for own in found.part_effects]
        model = FormulaModel(problem, choices, (*base, effect), part_effects, heldout)
        return FormulaSearch(found, model, imitators)
    except LinAlgError:
        return None
