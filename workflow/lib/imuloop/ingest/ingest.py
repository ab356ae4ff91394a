"""One raw log into canonical samples and its quality figures.

Read the files, find columns and units, find one clock, convert once, check, write.
"""

import os
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError, MachineFault, RejectedLog
from imuloop.core.files import replaced, write_json
from imuloop.core.samples import CHANNELS, LOGGED_TIME, TEMPERATURE, TIME, schema
from imuloop.core.units import STANDARD_GRAVITY, raw_unit
from imuloop.ingest import checks, clocks, even_stamps, increments, pps, quality, reference
from imuloop.ingest.convert import Counts, no_samples, si_samples
from imuloop.ingest.formats import find_format
from imuloop.ingest.places import PAIR, for_reader, in_config
from imuloop.ingest.plausible import milliseconds
from imuloop.ingest.raw_log import RawLog, absent_sensor, all_rows
from imuloop.ingest.sources import sha256
from imuloop.ingest.spellings import SENSORS, UNITS, is_iso, stated_unit, unknown_unit
from imuloop.ingest.stamps import iso_text
from imuloop.ingest.timing import find_timing

# rows per row group of samples.parquet: 8 columns of it are 8 MB
ROW_GROUP = 1 << 17
_COUNTED = (
    *("duplicates", "identical", "out_of_order", "non_finite", "missing_values"),
    *("impossible_values", "spiked", "spike_values", "increments"),
)
# quantities that have a unit whether or not the log holds them
_WITH_UNIT = ("time", *SENSORS)


@dataclass(frozen=True)
class Declared:
    """What the config says of a log; what is left out is found from the log, units else SI.

    Attributes
    ----------
    sources : dict of str to dict
        Role of each file (``log``, or ``acceleration`` and ``angular_rate``; ``reference``,
        ``pps``) to its source; of one file a log, of two a sensor each.
    columns, units, nominal, full_scale : dict
        By quantity.
    reference, known_rotation : dict, list
        Of a reference, and of turns that are known.
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
        """Return what of the log itself is declared, as in the config."""
        names = ("format", "columns", "units", "rate", "full_scale")
        return {name: value for name in names if (value := getattr(self, name))}


@dataclass(frozen=True)
class Reading:
    """A log as it was read, and the unit of each quantity.

    `files` maps the role of each file to its path; `state` is their state before they were read;
    `format` is that of the log. `absent` is the quantity of a sensor that the log lacks, `fault`
    the RejectedLog that says why it cannot be used; `doubts` are lines on its units.
    """

    files: dict = field(default_factory=dict)
    state: dict = field(default_factory=dict)
    format: str | None = None
    log: RawLog = field(default_factory=RawLog)
    units: dict = field(default_factory=lambda: {q: units[0] for q, units in UNITS.items()})
    nominal: dict = field(default_factory=dict)
    absent: str | None = None
    fault: RejectedLog | None = None
    doubts: list = field(default_factory=list)

    @cached_property
    def raw_units(self):
        """Unit of each sensor, a `RawUnit`, by its quantity."""
        scales = {q: self.log.nominal.get(q, {}) | self.nominal.get(q, {}) for q in SENSORS}
        return {q: raw_unit(q, self.units[q], scales[q]) for q in SENSORS}


def ingest(*, device, session, kind, paths, samples_path, quality_path, declared=None):
    """Write samples.parquet and quality.json of one session, each in one step.

    What is wrong in the data is a result: `status` is ``rejected``, with reasons, and the samples
    are empty.

    Parameters
    ----------
    kind : str or None
        What was done with the device, None where that is not known.
    paths : list of path-like
        Files of the log, or its folder, in the order of the declared sources.
    declared : Declared, optional
        What the config says of the log.

    Raises
    ------
    ImuloopError
        If what is declared does not fit the log; one line with device, session and file.
    """
    declared, paths = declared or Declared(), [Path(path) for path in paths]
    who = {"device": device, "session": session, "kind": kind}
    try:
        reading = read(paths, declared)
        samples, found, origin = check(reading, *convert(reading, declared), declared, kind)
        _write(samples_path, quality_path, samples, found, who | origin)
    except (ImuloopError, PermissionError) as error:
        names = ", ".join(os.fsencode(path).decode(errors="backslashreplace") for path in paths)
        of_machine = isinstance(error, PermissionError)
        type_of, text = (MachineFault, error.strerror) if of_machine else (type(error), error)
        whose = f"{device}/{session}: " if in_config() else ""
        raise type_of(for_reader(f"{whose}{names}: {text}")) from error


def write_rejected(*, device, session, kind, samples_path, quality_path, reason):
    """Write samples without rows and a quality with the reason, for a log that does not fit.

    Parameters are as in `ingest`; the reason is about what is declared.
    """
    who, reading = {"device": device, "session": session, "kind": kind}, Reading()
    none = no_samples(reading.log), Counts(reasons=[reason])
    samples, found, origin = check(reading, *none, Declared(), kind)
    _write(samples_path, quality_path, samples, found | {"misdeclared": True}, who | origin)


def read(paths, declared):
    """Return the `Reading` of the files at paths."""
    for path in paths:
        if any("\ud800" <= c <= "\udfff" for c in str(path)):
            raise ImuloopError("its name is no UTF-8: rename it")
        if not (path.is_file() or path.is_dir()):
            raise ImuloopError("there is no such file")
    state = _state(paths)
    roles = declared.sources or (["log"] if len(paths) == 1 else SENSORS)
    files = dict(zip(roles, paths, strict=True))
    own = {role: path for role, path in files.items() if role not in ("pps", "reference")}
    in_log = declared.pps and "pps" not in files
    columns = declared.columns | ({"pps": declared.pps} if in_log else {})
    log_format, log, absent, fault = declared.format, RawLog(), None, None
    try:
        log_format, form = find_format(declared.format, own)
        log = form.read(own, columns or None)
        absent = absent_sensor(log, columns)
    except RejectedLog as error:
        log, fault = RawLog(), error
    units, doubts = choose_units(log, declared.units)
    how = absent, fault, doubts
    return Reading(files, state, log_format, log, units, declared.nominal, *how)


def choose_units(log, declared):
    """Return the unit of each quantity, and where the log itself says otherwise (texts).

    `declared` are those of the config; an ImuloopError where one is no unit.
    """
    stamps = log.found.get("time")
    if list in map(type, stamps.values() if isinstance(stamps, dict) else [stamps]):
        # two columns are joined to ns, whatever is declared of them
        declared = declared | {"time": "ns"}
    used = {q: declared.get(q) or log.units.get(q) or units[0] for q, units in UNITS.items()}
    for quantity, unit in used.items():
        # ISO 8601 stamps need no unit, and others only where they are numbers
        of_dates = quantity == "time" and (is_iso(unit) or quantity not in declared)
        if unit in UNITS[quantity] or of_dates:
            continue
        if quantity not in declared:
            raise unknown_unit(quantity, unit)
        # that of sensors is checked with their scale
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


def convert(reading, declared):
    """Return the samples of a log on its one clock, and their `Counts`."""
    log, units, counts = reading.log, reading.units, Counts(read=reading.log.batch.num_rows)
    try:
        if reading.fault:
            raise reading.fault
        rows = all_rows(log, units, declared.rate)
        if not counts.read:
            return no_samples(log), counts
        timing = find_timing(rows, log, units, declared, reading.files.get("pps"))
        samples, counts = si_samples(rows, timing, log, units, reading.raw_units)
    except RejectedLog as error:
        return no_samples(log), replace(counts, reasons=[str(error)])
    if timing.logged is not None:
        counts.logged = quality.time_figures(timing.logged)
        del counts.logged["rows"]
        counts.rebuilt = even_stamps.rebuilt_line(timing, counts.logged)
    return samples, counts


def check(reading, samples, counts, declared, kind):
    """Return the samples, none of a rejected log, what quality.json says, and their origin."""
    log, raw_units, absent = reading.log, reading.raw_units, reading.absent
    full_scale, rate = declared.full_scale, declared.rate
    reasons = counts.reasons

    def measured():
        return _drop_absent(absent, quality.measure(samples, raw_units, full_scale))

    figures, in_ms = measured(), None
    unstated = not ("time" in declared.units or "time" in log.units or counts.start_ns)
    if unstated and counts.time_unit == "s":
        in_ms = milliseconds(samples, figures, samples.get(LOGGED_TIME, samples[TIME]), rate)
    bursts = even_stamps.bursts_fault(samples[TIME], figures["gaps"], rate)
    dropped, at = figures.pop("isolated")
    if len(dropped):
        number = np.bincount(at, minlength=len(CHANNELS)).tolist()
        counts.spike_values = dict(zip(CHANNELS, number, strict=True))
        counts.spiked = len(np.unique(dropped))
        samples = {name: np.delete(x, dropped) for name, x in samples.items()}
        # the gaps that this leaves are counted as spikes
        figures = measured() | {"gaps": figures["gaps"]}
        del figures["isolated"]
    # without an accelerometer there is no yardstick
    gravity = None if absent == "acceleration" else declared.gravity
    how = raw_units, gravity, kind, declared.nominal, rate
    findings = checks.findings(checks.Evidence(figures, counts, log, *how))
    wrong, doubts = findings[checks.MISDECLARED], findings[checks.DOUBTFUL]
    if bursts:
        # the rate is wrong, and what was found by it
        many = figures["gaps"]["count"] > even_stamps.MOST_BURSTS
        wrong, doubts = ([bursts], []) if many else ([], [bursts])
    wrong += [in_ms] if in_ms else []
    if _state(reading.files.values()) != reading.state:
        reasons = ["the file changed while it was read"]
    if unread := findings[checks.UNREADABLE]:
        reasons, wrong, doubts = reasons or unread, [], []
        counts.logged = counts.rebuilt = None
    reasons = reasons or findings[checks.UNUSABLE]
    doubts = log.notes + findings[checks.WARNING] * bool(figures["rows"]) + doubts
    units = reading.units | ({"time": counts.time_unit} if counts.time_unit else {})
    origin = _origin(reading, declared) | {"units": units}
    if counts.start_ns is not None:
        origin["start"] = iso_text(counts.start_ns)
    known = {"rails": quality.rails(figures, full_scale), "stuck": quality.stuck(figures)}
    origin |= {name: found for name, found in known.items() if found}
    if declared.reference and not (reasons or wrong):
        own = declared.of_log() | {"units": units}
        how = reading.files, declared.reference, own, counts
        columns, beside, wrong = reference.beside(samples, *how)
        origin["reference"] = beside
        samples |= columns
    lines = reading.doubts + pps.warnings(counts.pps)
    lines += increments.warnings(counts.increments, figures)
    lines += [counts.rebuilt] if counts.rebuilt else []
    lines += counts.clock.warnings()
    if absent:
        why = f"what needs it is not testable; give both files where another holds it, {PAIR}"
        lines.append(f"the log holds no {absent}: {why}")
    lines += doubts
    found = {
        "format": 1,
        "status": "rejected" if reasons or wrong else "ok",
        "reasons": [*map(for_reader, reasons or wrong)],
        # whether the entry, not the log, is what the reasons are about
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


def _drop_absent(absent, figures):
    """Return quality figures without those of a sensor, by quantity, that is `absent`, if any."""
    if not absent:
        return figures
    axes, faults = SENSORS[absent], figures["faults"]
    figures["constant"] = [name for name in figures["constant"] if name not in axes]
    figures["range"] |= dict.fromkeys(axes)
    if faults:
        faults["zero_rows"][absent] = 0
        # a change of the force is no fault where turns are not seen
        if absent == "angular_rate" and faults["rests"]:
            faults["rests"]["jump_m_s2"] = 0.0
    return figures


def _origin(reading, declared):
    """Return where samples come from, as far as it is known before the log is converted."""
    own = {role: path for role, path in reading.files.items() if role not in ("pps", "reference")}
    origin = {
        "log_format": reading.format,
        "source": declared.sources or {role: {"path": str(path)} for role, path in own.items()},
        "sha256": _hashes([*reading.state]),
        "raw_units": {quantity: vars(unit) for quantity, unit in reading.raw_units.items()},
        "declared": declared.of_log(),
        "sensor_ids": reading.log.sensor_ids,
        "simulated": reading.log.simulated,
        "start": None,
    }
    return origin | ({"known_rotation": r} if (r := declared.known_rotation) else {})


def _write(samples_path, quality_path, samples, found, origin):
    """Write samples.parquet and quality.json.

    Values of few levels are written as numbers of these, time stamps are not.
    """
    of_levels = [name for name in samples if name in (*CHANNELS, TEMPERATURE)]
    table, how = pa.table(samples), {"compression": "zstd", "use_dictionary": of_levels}
    how["use_byte_stream_split"] = [name for name in samples if name not in of_levels]
    with replaced(samples_path) as temporary:
        # doubles need no schema of Arrow
        with pq.ParquetWriter(temporary, table.schema, store_schema=False, **how) as writer:
            writer.write_table(table, row_group_size=ROW_GROUP)
            writer.add_key_value_metadata(schema(origin).metadata)
    write_json(quality_path, found | origin)


def _state(paths):
    """Return what differs once a file at the paths, or in a folder there, is written to."""
    files = [f for path in paths for f in (sorted(path.iterdir()) if path.is_dir() else [path])]
    found = {}
    # one that is gone differs, too
    for path in filter(Path.is_file, files):
        with suppress(FileNotFoundError):
            state = path.stat()
            found[path] = state.st_ino, state.st_size, state.st_mtime_ns
    return found


def _hashes(files):
    """Return file name (path, where names repeat) -> SHA-256."""
    distinct, found = len({path.name for path in files}) == len(files), {}
    for path in files:
        # one that is gone meanwhile has changed
        with suppress(FileNotFoundError):
            found[path.name if distinct else str(path)] = sha256(path)
    return found
