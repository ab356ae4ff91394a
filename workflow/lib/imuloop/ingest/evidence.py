"""The state of a log in ingest: its declaration, the log as read, its samples and figures."""

from collections import defaultdict
from dataclasses import dataclass, field

from imuloop.core.samples import CHANNELS
from imuloop.core.units import STANDARD_GRAVITY, raw_unit
from imuloop.ingest.convert import Counts
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.spellings import SENSORS, UNITS


@dataclass(frozen=True)
class Declared:
    """The declarations about a log: keys of the config. What is not declared is found in the log.

    Attributes
    ----------
    sources : dict of str to dict
        Source of each file by its role: ``log``, or ``acceleration`` and ``angular_rate`` for a log
        in two files; ``reference`` and ``pps`` if they have their own files.
    columns, units, nominal, full_scale : dict
        Columns, units, scales of counts, and full scales by quantity.
    reference, known_rotation : dict, list
        Keys of the config about a reference, and about turns that are known.
    rate, gravity : float
        Samples per second, Hz, and local gravity, m/s^2.
    """

    format: str | None = None
    sources: dict = field(default_factory=dict)
    columns: dict = field(default_factory=dict)
    units: dict = field(default_factory=dict)
    rate: float | None = None
    time_range: list | None = None
    pps: dict = field(default_factory=dict)
    reference: dict = field(default_factory=dict)
    known_rotation: list = field(default_factory=list)
    nominal: dict = field(default_factory=dict)
    full_scale: dict = field(default_factory=dict)
    gravity: float = STANDARD_GRAVITY

    def of_log(self):
        """Return the declared keys about the log itself, a dict as in the config, as ``units``."""
        names = ("format", "columns", "units", "rate", "full_scale")
        return {name: value for name in names if (value := getattr(self, name))}


@dataclass
class Evidence:
    """All that ingest knows about a log, the input of `checks`. Each step of ingest adds to it.

    Attributes
    ----------
    declared : Declared
        Keys of the config about the log.
    kind : str or None
        Kind of the session, such as "static"; None if it is not known.
    files : dict
        Path of each file by its role.
    format : str or None
        Name of the log's format.
    log : RawLog
        The log as it was read.
    units : dict
        Unit of each quantity in the log.
    absent : str or None
        Quantity of the sensor that the log lacks.
    doubts : list of str
        Lines on declared units that differ from those that the log states.
    samples : dict
        Samples on one clock, SI: columns of shape (n,) by name.
    counts : Counts
        Numbers of used and dropped rows.
    figures : dict
        The quality figures, as in quality.json.
    """

    declared: Declared = field(default_factory=Declared)
    kind: str | None = None
    files: dict = field(default_factory=dict)
    format: str | None = None
    log: RawLog = field(default_factory=RawLog)
    units: dict = field(default_factory=lambda: {q: units[0] for q, units in UNITS.items()})
    absent: str | None = None
    doubts: list = field(default_factory=list)
    samples: dict = field(default_factory=dict)
    counts: Counts = field(default_factory=Counts)
    figures: dict = field(default_factory=dict)

    @property
    def of_log(self):
        """The files of the log itself, by role."""
        return {r: path for r, path in self.files.items() if r not in ("pps", "reference")}

    @property
    def raw_units(self):
        """Unit of each sensor, a `RawUnit`, by its quantity."""
        logged, declared = self.log.nominal, self.declared.nominal
        scales = {q: logged.get(q, {}) | declared.get(q, {}) for q in SENSORS}
        return {q: raw_unit(q, self.units[q], scales[q]) for q in SENSORS}

    @property
    def faults(self):
        """The figures ``faults`` of the samples; without them, an empty dict for each name."""
        return self.figures["faults"] or defaultdict(dict)

    @property
    def inside(self):
        """The number of rows in the time range, plus the lines that cannot be read."""
        counts = self.counts
        return counts.read - counts.outside - counts.identical + self.log.bad_lines

    @property
    def is_cut(self):
        """Whether a channel is constant, stuck or clipped, at least in a part of the log.

        Its mean size and its turns are then wrong, too, and show nothing about its scale.
        """
        faults = [*self.faults["stuck"].values(), *self.faults["clipped_at"].values()]
        rows = [fault["rows"] for fault in faults] + [*self.figures["clipped"].values()]
        return any(rows) or any(name in CHANNELS for name in self.figures["constant"])
