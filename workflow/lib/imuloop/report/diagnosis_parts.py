"""The diagnosis of each sensor and kind of data, in the order in which a person reads it."""

from dataclasses import dataclass

from imuloop.report.advice import what_next
from imuloop.report.allan_plot import corrected_pictures
from imuloop.report.bias_plot import bias_pictures
from imuloop.report.correlate_plot import correlate_pictures
from imuloop.report.diagnosis_tables import blocks, effect_tables, effect_units, steps_table
from imuloop.report.ranking import limit_table, ranking_table, twin_table
from imuloop.report.ranking_plot import ranking_pictures
from imuloop.report.residual_plot import residual_pictures
from imuloop.report.static_tables import heldout_by_session, noise_change_table, session_tables
from imuloop.report.svg import Picture
from imuloop.report.table import Table
from imuloop.report.verdict import PARTS, WORDS, sentence, verdict_of


@dataclass(frozen=True)
class Part:
    """The diagnosis of one sensor at its poses, or in its static records.

    Attributes
    ----------
    identity : str
        Where links to it lead.
    title : str
        Sensor and kind of data.
    verdict, sentence : str
        The contract's word, and the verdict in a sentence.
    residuals : list of Picture
        What is left, before and after.
    effects : list of Table
        What was added and its parameters, what it changed.
    allan : list of Picture
        Allan deviation as logged and corrected.
    candidates : list of Picture
        What each effect alone does to the held-out error.
    ranking, limits, twins : Table or None
        All candidates; their detection limits; those that cannot be told apart.
    left : list of Picture
        What the residual that is left goes with.
    next_step : str
        What a person can do about it; empty where nothing is left.
    """

    identity: str
    title: str
    verdict: str
    sentence: str
    residuals: list[Picture]
    effects: list[Table]
    allan: list[Picture]
    candidates: list[Picture]
    ranking: Table | None
    limits: Table | None
    twins: Table | None
    left: list[Picture]
    next_step: str

    @property
    def words(self):
        """The verdict in words, with which the sentence begins."""
        return WORDS.get(self.verdict, self.verdict)


def diagnosis_parts(device, folder):
    """Return every part of a device's diagnosis.

    Parameters
    ----------
    device : Device
        The device.
    folder : Path
        Where the CSV files of the figures go.
    """
    return [_part(device, *block, folder) for block in blocks(device)]


def _part(device, sensor, part, block, folder):
    verdict = verdict_of(block)
    above = verdict in ("unexplained", "partly_explained")
    tables = [steps_table(sensor, part, block), *effect_tables(sensor, part, block)]
    pictures, allan = [], []
    if part == "poses":
        pictures = residual_pictures(device, sensor, block, folder)
    else:
        pictures = bias_pictures(device, sensor, block, folder)
        allan = corrected_pictures(device, sensor, folder) if block.get("effects") else []
        tables += [
            heldout_by_session(device, sensor, block),
            *session_tables(device, sensor, block, effect_units(block)),
            noise_change_table(sensor, block),
        ]
    return Part(
        f"{device.name}.{sensor}.{part}",
        f"{sensor.capitalize()}, {PARTS[part]}",
        verdict,
        sentence(sensor, block),
        pictures,
        [t for t in tables if t],
        allan,
        ranking_pictures(device, sensor, part, block, folder),
        ranking_table(sensor, part, block),
        limit_table(sensor, part, block),
        twin_table(sensor, part, block),
        correlate_pictures(device, sensor, part, block, folder) if above else [],
        what_next(block) if above else "",
    )
