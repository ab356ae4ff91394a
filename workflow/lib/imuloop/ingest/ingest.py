"""From one raw log to its canonical samples and quality figures.

The steps are: read the files, find columns and units, find one clock, convert, check, write.
"""

import os
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError, MachineFault, RejectedLog
from imuloop.core.files import replaced, write_json
from imuloop.core.samples import CHANNELS, LOGGED_TIME, TEMPERATURE, TIME, schema
from imuloop.core.units import STANDARD_GRAVITY, raw_unit
from imuloop.ingest import checks, clocks, even_stamps, increments, pps, quality, reference
from imuloop.ingest.columns import STAMP
from imuloop.ingest.convert import Counts, no_samples, si_samples
from imuloop.ingest.formats import find_format
from imuloop.ingest.places import PAIR, for_reader, in_config
from imuloop.ingest.plausible import milliseconds
from imuloop.ingest.raw_log import RawLog, absent_sensor
from imuloop.ingest.rows import Rows
from imuloop.ingest.sources import sha256
from imuloop.ingest.spellings import SENSORS, UNITS, is_iso, stated_unit, unknown_unit
from imuloop.ingest.stamps import iso_text

# rows of a row group in samples.parquet: 8 columns of a row group have 8 MB
ROW_GROUP = 1 << 17
_COUNTED = (
    *("duplicates", "identical", "out_of_order", "non_finite", "missing_values"),
    *("impossible_values", "spiked", "spike_values", "increments"),
)
# quantities that have a unit whether or not the log holds them
_WITH_UNIT = ("time", *SENSORS)


@dataclass(frozen=True)
class Declared:
    """Keys of the config about a log; columns and units that are not declared are found in the log.

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
        """Return the declared keys about the log itself, a dict as in the config."""
        names = ("format", "columns", "units", "rate", "full_scale")
        return {name: value for name in names if (value := getattr(self, name))}


@dataclass
class Reading:
    """A log as it was read, and the unit of each quantity.

    `declared` are the keys of the config about the log. `files` maps the role of each file to its
    path, and `state` is the state of the files before they were read. `format` is the name of the
    log's format. `absent` is the quantity of a sensor that the log lacks, or None. `fault` is the
    RejectedLog that says why the log cannot be used, or None. `doubts` are lines on its units.
    """

    declared: Declared = field(default_factory=Declared)
    files: dict = field(default_factory=dict)
    state: dict = field(default_factory=dict)
    format: str | None = None
    log: RawLog = field(default_factory=RawLog)
    units: dict = field(default_factory=lambda: {q: units[0] for q, units in UNITS.items()})
    absent: str | None = None
    fault: RejectedLog | None = None
    doubts: list = field(default_factory=list)

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


def ingest(*, device, session, kind, paths, samples_path, quality_path, declared=None):
    """Write samples.parquet and quality.json of one session, each in one step.

    A fault in the data is a result: `status` is then ``rejected``, with the reasons, and the table
    of samples has no rows.

    Parameters
    ----------
    device, session : str
        Names of the device and the session.
    kind : str or None
        Kind of the session, such as "static"; None if it is not known.
    paths : list of path-like
        Files of the log, or its folder, in the order of the declared sources.
    samples_path, quality_path : path-like
        Paths of the results.
    declared : Declared, optional
        Keys of the config about the log.

    Raises
    ------
    ImuloopError
        If a declaration does not fit the log; one line with device, session and file.
    """
    declared, paths = declared or Declared(), [Path(path) for path in paths]
    who = {"device": device, "session": session, "kind": kind}
    try:
        reading = read(paths, declared)
        samples, found, origin = check(reading, *convert(reading), kind)
        _write(samples_path, quality_path, samples, found, who | origin)
    except (ImuloopError, OSError) as error:
        names = ", ".join(os.fsencode(path).decode(errors="backslashreplace") for path in paths)
        fault, text = type(error), error
        if isinstance(error, OSError):
            fault, text = MachineFault, error.strerror or error
        whose = f"{device}/{session}: " if in_config() else ""
        raise fault(for_reader(f"{whose}{names}: {text}")) from error


def write_rejected(*, device, session, kind, samples_path, quality_path, reason):
    """Write samples without rows, and a quality with the `reason` why the declaration does not fit.

    `device`, `session` and `kind` are the names of the device and the session, and the kind of the
    session. `samples_path` and `quality_path` are the paths of the results.
    """
    who, reading = {"device": device, "session": session, "kind": kind}, Reading()
    none = no_samples(reading.log), Counts(reasons=[reason])
    samples, found, origin = check(reading, *none, kind)
    _write(samples_path, quality_path, samples, found | {"misdeclared": True}, who | origin)


def read(paths, declared):
    """Return the `Reading` of the files at `paths`, which are in the order of the declared sources.

    `declared` is the Declared of the log. Raises an ImuloopError if a file does not exist, or if a
    declaration does not fit.
    """
    for path in paths:
        if any("\ud800" <= c <= "\udfff" for c in str(path)):
            raise ImuloopError("its name is no UTF-8: rename it")
        if not (path.is_file() or path.is_dir()):
            raise ImuloopError("there is no such file")
    roles = declared.sources or (["log"] if len(paths) == 1 else SENSORS)
    files = dict(zip(roles, paths, strict=True))
    found = Reading(declared, files, _state(paths), declared.format)
    in_log = declared.pps and "pps" not in files
    columns = declared.columns | ({"pps": declared.pps} if in_log else {})
    try:
        found.format, reader = find_format(declared.format, found.of_log)
        log = found.log = reader(found.of_log, columns or None)
        empty = "time" in log.found and log.batch[STAMP].null_count == log.batch.num_rows
        if empty and declared.rate and "time" not in columns:
            # the rate is enough
            log.batch = log.batch.drop_columns([STAMP])
            del log.found["time"]
        found.absent = absent_sensor(found.log, columns)
    except RejectedLog as error:
        found.log, found.fault = RawLog(), error
    found.units, found.doubts = choose_units(found.log, declared.units)
    return found


def choose_units(log, declared):
    """Return the unit of each quantity, a dict, and lines on units that the log states otherwise.

    `declared` are the units of the config by quantity. Raises an ImuloopError for an unknown unit.
    """
    stamps = log.found.get("time")
    if list in map(type, stamps.values() if isinstance(stamps, dict) else [stamps]):
        # two columns are joined to ns, with any declaration
        declared = declared | {"time": "ns"}
    used = {q: declared.get(q) or log.units.get(q) or units[0] for q, units in UNITS.items()}
    for quantity, unit in used.items():
        # stamps of ISO 8601 need no unit; an unknown unit of time is a fault only if it is declared
        of_dates = quantity == "time" and (is_iso(unit) or quantity not in declared)
        if unit in UNITS[quantity] or of_dates:
            continue
        if quantity not in declared:
            raise unknown_unit(quantity, unit)
        # units of sensors are checked with their scale
        if quantity not in SENSORS:
            near = stated_unit(quantity, unit)
            hint = f"did you mean '{near}'?" if near else f"use one of {', '.join(UNITS[quantity])}"
            raise ImuloopError(f"units.{quantity}: '{unit}' is not a unit; {hint}")
    doubts = [
        f"units.{quantity} is {unit}, the log says {stated}; {unit} used"
        for quantity, unit in used.items()
        if (stated := log.units.get(quantity, unit)) != unit
    ]
    return {q: u for q, u in used.items() if q in _WITH_UNIT or q in log.found}, doubts


def convert(reading):
    """Return the samples of a Reading on one clock, columns by name, and their `Counts`.

    A log that cannot be used has no samples; its Counts have the reasons.
    """
    log, counts = reading.log, Counts(read=reading.log.batch.num_rows)
    try:
        if reading.fault:
            raise reading.fault
        rows = Rows(log, reading.units, reading.declared)
        if not counts.read:
            return no_samples(log), counts
        rows.find_clock(reading.files.get("pps"))
        samples, counts = si_samples(rows, reading.raw_units)
    except RejectedLog as error:
        return no_samples(log), replace(counts, reasons=[str(error)])
    if rows.logged is not None:
        counts.logged = quality.time_figures(rows.logged)
        del counts.logged["rows"]
        counts.rebuilt = even_stamps.rebuilt_line(rows)
    return samples, counts


def check(reading, samples, counts, kind):
    """Return the samples of a Reading, the content of quality.json, and the origin of the samples.

    The samples are columns by name, without rows if the log is rejected; the others are dicts.
    `samples` and `counts` are the converted samples and their `Counts`, and `kind` is the kind of
    the session.
    """
    log, raw_units, declared = reading.log, reading.raw_units, reading.declared
    figures, in_ms, rate = _measure(reading, samples), None, declared.rate
    unstated = not ("time" in declared.units or "time" in log.units or counts.start_ns)
    if unstated and counts.time_unit == "s":
        in_ms = milliseconds(samples, figures, samples.get(LOGGED_TIME, samples[TIME]), rate)
    dropped, channels = figures.pop("isolated")
    if len(dropped):
        number = np.bincount(channels, minlength=len(CHANNELS)).tolist()
        counts.spike_values = dict(zip(CHANNELS, number, strict=True))
        counts.spiked = len(np.unique(dropped))
        samples = {name: np.delete(x, dropped) for name, x in samples.items()}
        # the gaps from dropped spikes are not counted as gaps
        figures = _measure(reading, samples) | {"gaps": figures["gaps"]}
        del figures["isolated"]
    # without an accelerometer nothing can be compared with gravity
    gravity = None if reading.absent == "acceleration" else declared.gravity
    of_log = {"figures": figures, "counts": counts, "log": log, "units": raw_units, "kind": kind}
    findings = checks.findings(
        checks.Evidence(**of_log, gravity=gravity, nominal=declared.nominal, rate=rate)
    )
    wrong, doubts = findings[checks.MISDECLARED], findings[checks.DOUBTFUL]
    wrong += [in_ms] if in_ms else []
    reasons, unread = counts.reasons, findings[checks.UNREADABLE]
    if _state(reading.files.values()) != reading.state:
        reasons = ["the file changed while it was read"]
    if unread:
        wrong, doubts, counts.logged, counts.rebuilt = [], [], None, None
    reasons = reasons or unread or findings[checks.UNUSABLE]
    origin = _origin(reading, counts)
    ends = {"rails": quality.rails(figures, declared.full_scale), "stuck": quality.stuck(figures)}
    origin |= {name: found for name, found in ends.items() if found}
    if declared.reference and not (reasons or wrong):
        session = declared.of_log() | {"units": origin["units"]}
        columns, origin["reference"], wrong = reference.beside(
            samples, reading.files, declared.reference, session, counts
        )
        samples |= columns
    lines = reading.doubts + pps.warnings(counts.pps)
    lines += increments.warnings(counts.increments, figures)
    lines += [counts.rebuilt] * bool(counts.rebuilt) + counts.clock.warnings()
    if reading.absent:
        why = f"what needs it is not testable; give both files where another holds it, {PAIR}"
        lines.append(f"the log holds no {reading.absent}: {why}")
    lines += log.notes + findings[checks.WARNING] * bool(figures["rows"]) + doubts
    found = {
        "format": 1,
        "status": "rejected" if reasons or wrong else "ok",
        "reasons": [*map(for_reader, reasons or wrong)],
        # whether the reasons are about the declaration in the config, not about the log
        "misdeclared": bool(wrong and not reasons),
        "warnings": [*map(for_reader, lines)],
        **figures,
        "clock": clocks.figures(counts, figures, rate if "time" in log.found else None),
        **{name: getattr(counts, name) for name in _COUNTED},
        "bad_lines": log.bad_lines,
        "rows_read": counts.read,
        "outside_time_range": counts.outside,
        "columns": log.found,
    }
    return no_samples(log) if reasons or wrong else samples, found, origin


def _measure(reading, samples):
    """Return the quality figures of samples, with neutral figures for an absent sensor, a dict."""
    figures = quality.measure(samples, reading.raw_units, reading.declared.full_scale)
    absent, faults = reading.absent, figures["faults"]
    if absent:
        axes = SENSORS[absent]
        figures["constant"] = [name for name in figures["constant"] if name not in axes]
        figures["range"] |= dict.fromkeys(axes)
    if absent and faults:
        faults["zero_rows"][absent] = 0
        # without a gyroscope a change of the force may be a turn, which is not a fault
        if absent == "angular_rate" and faults["rests"]:
            faults["rests"]["jump_m_s2"] = 0.0
    return figures


def _origin(reading, counts):
    """Return the origin of samples, a dict: their files, units, declarations and start."""
    files, paths, declared = reading.of_log, [*reading.state], reading.declared
    distinct = len({path.name for path in paths}) == len(paths)
    start, turned = counts.start_ns, declared.known_rotation
    return {
        "log_format": reading.format,
        "source": declared.sources or {role: {"path": str(path)} for role, path in files.items()},
        # if two files have the same name, their paths are the keys
        "sha256": {p.name if distinct else str(p): sha256(p) for p in paths if p.is_file()},
        "raw_units": {quantity: vars(unit) for quantity, unit in reading.raw_units.items()},
        "declared": declared.of_log(),
        "sensor_ids": reading.log.sensor_ids,
        "simulated": reading.log.simulated,
        "start": None if start is None else iso_text(start),
        "units": reading.units | ({"time": counts.time_unit} if counts.time_unit else {}),
    } | ({"known_rotation": turned} if turned else {})


def _write(samples_path, quality_path, samples, found, origin):
    """Write samples.parquet and quality.json.

    Channels are written with a dictionary, as they have few different values; times are not.
    """
    of_levels = [name for name in samples if name in (*CHANNELS, TEMPERATURE)]
    table, how = pa.table(samples), {"compression": "zstd", "use_dictionary": of_levels}
    how["use_byte_stream_split"] = [name for name in samples if name not in of_levels]
    with replaced(samples_path) as temporary:
        # a table of float64 can be read without a stored schema of Arrow
        with pq.ParquetWriter(temporary, table.schema, store_schema=False, **how) as writer:
            writer.write_table(table, row_group_size=ROW_GROUP)
            writer.add_key_value_metadata(schema(origin).metadata)
    write_json(quality_path, found | origin)


def _state(paths):
    """Return figures by file that change with each write: inode, size and time of the last change.

    The files are those at `paths`; a folder stands for the files in it.
    """
    files = [f for path in paths for f in (sorted(path.iterdir()) if path.is_dir() else [path])]
    stats = {file: file.stat() for file in files if file.is_file()}
    return {file: (s.st_ino, s.st_size, s.st_mtime_ns) for file, s in stats.items()}
