"""One raw log into canonical samples and its quality figures.

Read the files, find columns and units, find one clock, convert once, check, write.
"""

import os
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError, MachineFault, RejectedLog
from imuloop.core.files import replaced, write_json
from imuloop.core.places import PAIR, for_reader, in_config
from imuloop.core.samples import CHANNELS, LOGGED_TIME, TEMPERATURE, TIME, schema
from imuloop.core.units import STANDARD_GRAVITY, RawUnit, raw_unit
from imuloop.ingest import clocks, even_stamps, increments, pps, quality, reference, slower_sensor
from imuloop.ingest.convert import Counts, no_samples, si_samples
from imuloop.ingest.formats import find_format
from imuloop.ingest.plausible import judged, milliseconds
from imuloop.ingest.raw_log import RawLog, absent_sensor, all_rows
from imuloop.ingest.sources import sha256
from imuloop.ingest.spellings import SENSORS, UNITS, is_iso, stated_unit, unknown_unit
from imuloop.ingest.stamps import iso_text
from imuloop.ingest.timing import Timing, find_timing

# rows per row group of samples.parquet: 8 columns of it are 8 MB
ROW_GROUP = 1 << 17
_COUNTED = (
    *("duplicates", "identical", "out_of_order", "non_finite", "missing_values"),
    *("impossible_values", "spiked", "spike_values"),
)


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
    """A log as it was read, the units of its quantities, and the state of its files before that.

    `files` maps the role of each file to its path; `origin` is what is known of where samples come
    from; `absent` is the quantity of a sensor that the log lacks; `fault` is why it cannot be used;
    `warnings` are lines on its units.
    """

    files: dict
    state: list
    log: RawLog
    units: dict
    raw_units: dict[str, RawUnit]
    origin: dict
    absent: str | None
    fault: RejectedLog | None
    warnings: list[str]


@dataclass(frozen=True)
class Conversion:
    """Samples of a log in SI, what became of its rows, and when they were sampled.

    Of a log that cannot be used samples have no rows, `timing` is None and `reasons` say why.
    """

    samples: dict
    counts: Counts
    timing: Timing | None
    reasons: list[str]


@dataclass(frozen=True)
class Verdict:
    """What the checks of samples found: their figures, and lines on what is wrong.

    `reasons` reject the session; they are `misdeclared` where the entry, not the log, is what they
    are about. `origin` is what they add to where samples come from.
    """

    samples: dict
    counts: Counts
    figures: dict
    reasons: list[str]
    misdeclared: bool
    warnings: list[str]
    origin: dict


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
    with _named(device, session, paths):
        reading = _read(paths, declared)
        conversion = _convert(reading, declared)
        verdict = _check(reading, conversion, declared, kind)
        origin = _origin(device, session, kind) | reading.origin | verdict.origin
        _write(samples_path, verdict.samples, origin)
    warnings = _warnings(reading, conversion, verdict, declared)
    write_json(quality_path, _quality(verdict, reading, declared, conversion, warnings) | origin)


def write_rejected(*, device, session, kind, samples_path, quality_path, reason):
    """Write samples without rows and a quality with the reason, for a log that does not fit.

    Parameters are as in `ingest`; the reason is about what is declared.
    """
    origin, samples = _origin(device, session, kind), no_samples(RawLog())
    raw_units = {quantity: RawUnit(**unit) for quantity, unit in origin["raw_units"].items()}
    figures = quality.measure(samples, raw_units)
    del figures["isolated"]
    verdict = Verdict(samples, Counts(), figures, [reason], True, [], {})
    _write(samples_path, samples, origin)
    write_json(quality_path, _quality(verdict) | origin)


@contextmanager
def _named(device, session, paths):
    """Put device, session and files before the text of an error."""
    try:
        yield
    except (ImuloopError, PermissionError) as error:
        names = ", ".join(os.fsencode(path).decode(errors="backslashreplace") for path in paths)
        kind, text = type(error), error
        if isinstance(error, PermissionError):
            kind, text = MachineFault, error.strerror
        whose = f"{device}/{session}: " if in_config() else ""
        raise kind(for_reader(f"{whose}{names}: {text}")) from error


def _read(paths, declared):
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
    columns = dict(declared.columns)
    if declared.pps and "pps" not in files:
        columns["pps"] = declared.pps
    log_format, form = find_format(declared.format, own)
    log, absent, fault = RawLog(), None, None
    try:
        log = form.read(own, columns or None)
        absent = absent_sensor(log, columns)
    except RejectedLog as error:
        log, fault = RawLog(), error
    units, warnings = used_units(log, declared.units)
    scales = {q: log.nominal.get(q, {}) | declared.nominal.get(q, {}) for q in SENSORS}
    raw_units = {q: raw_unit(q, units[q], scales[q]) for q in SENSORS}
    origin = {
        "log_format": log_format,
        "source": declared.sources or {role: {"path": str(path)} for role, path in own.items()},
        "sha256": _hashes(paths),
        "units": units,
        "raw_units": {quantity: vars(unit) for quantity, unit in raw_units.items()},
        "declared": declared.of_log(),
        "sensor_ids": log.sensor_ids,
        "simulated": log.simulated,
    }
    if declared.known_rotation:
        origin["known_rotation"] = declared.known_rotation
    return Reading(files, state, log, units, raw_units, origin, absent, fault, warnings)


def _convert(reading, declared):
    """Return the `Conversion` of a log."""
    log, units = reading.log, reading.units
    counts = Counts(read=log.batch.num_rows)
    try:
        if reading.fault:
            raise reading.fault
        rows = all_rows(log, units, declared.rate)
        if not len(rows.x):
            return Conversion(no_samples(log), counts, None, [])
        timing = find_timing(rows, log, units, declared, reading.files.get("pps"))
        samples, counts = si_samples(rows, timing, log, units, reading.raw_units)
    except RejectedLog as error:
        return Conversion(no_samples(log), counts, None, [str(error)])
    return Conversion(samples, counts, timing, [])


def _check(reading, conversion, declared, kind):
    """Return the `Verdict` on samples."""
    log, raw_units, absent = reading.log, reading.raw_units, reading.absent
    samples, counts, full_scale = conversion.samples, conversion.counts, declared.full_scale

    def measured():
        how = samples, *[log.slower] * bool(log.slower), raw_units, full_scale
        figures = (slower_sensor if log.slower else quality).measure(*how)
        return _without(absent, figures)

    figures, gravity, rate = measured(), declared.gravity, declared.rate
    stamped = samples.get(LOGGED_TIME, samples[TIME])
    unstated = not ("time" in declared.units or "time" in log.units or counts.start_ns)
    in_ms = None
    if unstated and counts.time_unit == "s":
        points = np.column_stack([stamped, stamped])
        in_ms = milliseconds(samples, figures, points, gravity, rate)
    bursts = even_stamps.broken(samples[TIME], figures["gaps"], rate)
    dropped, at = figures.pop("isolated")
    if len(dropped):
        number = np.bincount(at, minlength=len(CHANNELS)).tolist()
        spikes = dict(zip(CHANNELS, number, strict=True))
        counts = replace(counts, spiked=len(np.unique(dropped)), spike_values=spikes)
        samples = {name: np.delete(x, dropped) for name, x in samples.items()}
        # the gaps that this leaves are counted as spikes
        figures = measured() | {"gaps": figures["gaps"]}
        del figures["isolated"]
    known = {"rails": quality.rails(figures, full_scale), "stuck": quality.stuck(figures)}
    origin = {name: found for name, found in known.items() if found}
    origin |= {"start": iso_text(counts.start_ns)} if counts.start_ns is not None else {}
    units = reading.units | ({"time": counts.time_unit} if counts.time_unit else {})
    origin["units"] = units
    reasons, wrong, doubts = conversion.reasons, [], []
    # without gravity there is no yardstick
    if absent != "acceleration":
        wrong, doubts = judged(figures, raw_units, gravity, kind, declared.nominal)
    if bursts:
        # the rate is wrong, and what was found by it
        many = figures["gaps"]["count"] > even_stamps.MOST_BURSTS
        wrong, doubts = ([bursts], []) if many else ([], [bursts])
    wrong += [in_ms] if in_ms else []
    if _state([*reading.files.values()]) != reading.state:
        reasons = ["the file changed while it was read"]
    if unread := quality.unread(figures, counts):
        reasons, wrong, doubts = reasons or unread, [], []
    lost_share = log.lost_bytes / log.text_bytes if log.text_bytes else 0.0
    reasons = reasons or quality.reasons(figures, counts, log.bad_lines, lost_share)
    if declared.reference and not (reasons or wrong):
        files = reading.files.get("reference", reading.files.get("log")), reading.files.get("log")
        own = declared.of_log() | {"units": units}
        columns, beside, wrong = reference.beside(samples, *files, declared.reference, own, counts)
        origin["reference"] = beside
        samples |= columns
    misdeclared, reasons = bool(wrong and not reasons), reasons or wrong
    samples = no_samples(log) if reasons else samples
    return Verdict(samples, counts, figures, reasons, misdeclared, doubts, origin)


def _warnings(reading, conversion, verdict, declared):
    """Return what a user should look at, a line each."""
    log, timing, absent = reading.log, conversion.timing, reading.absent
    counts, figures = verdict.counts, verdict.figures
    found = [*reading.warnings]
    if timing and timing.timeline:
        found += pps.warnings(_marks(verdict, timing))
    summed = increments.figures(log, reading.units, counts, timing, declared.rate)
    found += increments.warnings(summed, figures)
    if timing and timing.logged is not None and not quality.unread(figures, counts):
        found.append(timing.line())
    found += counts.clock.warnings()
    if absent:
        why = f"what needs it is not testable; give both files where another holds it, {PAIR}"
        found.append(f"the log holds no {absent}: {why}")
    found += quality.warnings(figures, counts, log, rate=declared.rate) + verdict.warnings
    return found


def _marks(verdict, timing):
    """Return what quality.json says of 1PPS marks, None without."""
    if timing and timing.timeline:
        outside = zip(("before", "after"), verdict.counts.outside_marks, strict=True)
        return timing.timeline.figures | dict(outside)


def _without(absent, figures):
    """Return quality figures that do not speak of a sensor, by its quantity, that is not there."""
    if absent:
        axes = SENSORS[absent]
        figures["constant"] = [name for name in figures["constant"] if name not in axes]
        figures["range"] |= dict.fromkeys(axes)
        if figures["faults"]:
            figures["faults"]["zero_rows"][absent] = 0
            figures["faults"]["in_turn"] = dict.fromkeys(SENSORS, 0)
            # a change of the force is no fault where turns are not seen
            if absent == "angular_rate" and figures["faults"]["rests"]:
                figures["faults"]["rests"]["jump_m_s2"] = 0.0
    return figures


def _origin(device, session, kind):
    """Return where samples come from, as far as it is known before the log is read."""
    units = {quantity: known[0] for quantity, known in UNITS.items()}
    return {
        "device": device,
        "session": session,
        "kind": kind,
        "log_format": None,
        "source": {},
        "sha256": {},
        "units": units,
        "raw_units": {q: vars(raw_unit(q, units[q])) for q in SENSORS},
        "declared": {},
        "sensor_ids": {},
        "simulated": False,
        "start": None,
    }


def _quality(verdict, reading=None, declared=None, conversion=None, warnings=()):
    """Return the content of quality.json, without where samples come from."""
    counts, figures, clock, summed = verdict.counts, verdict.figures, None, None
    log = reading.log if reading else RawLog()
    if reading:
        timing, rate = conversion.timing, declared.rate
        logged = timing and timing.logged is not None and clocks.step_figures(timing.logged)
        logged = logged or None
        own_rate = "time" in log.found and rate
        clock = clocks.figures(counts.clock, figures, own_rate, logged, _marks(verdict, timing))
        summed = increments.figures(log, reading.units, counts, timing, rate)
    return {
        "format": 1,
        "status": "rejected" if verdict.reasons else "ok",
        "reasons": [*map(for_reader, verdict.reasons)],
        "misdeclared": verdict.misdeclared,
        "warnings": [*map(for_reader, warnings)],
        **figures,
        "clock": clock,
        "increments": summed,
        **{name: getattr(counts, name) for name in _COUNTED},
        "bad_lines": log.bad_lines,
        "rows_read": counts.read,
        "outside_time_range": counts.outside,
        "columns": log.found,
    }


def _write(path, samples, origin):
    """Write columns of samples as Parquet: values of few levels as numbers of these, stamps not."""
    table, levels = pa.table(samples), (*CHANNELS, TEMPERATURE)
    with replaced(path) as temporary:
        with pq.ParquetWriter(
            temporary,
            table.schema,
            compression="zstd",
            # doubles need none
            store_schema=False,
            use_dictionary=[name for name in samples if name in levels],
            use_byte_stream_split=[name for name in samples if name not in levels],
        ) as writer:
            writer.write_table(table, row_group_size=ROW_GROUP)
            writer.add_key_value_metadata(schema(origin).metadata)


def used_units(log, declared):
    """Return the unit of each quantity, and where the log itself says otherwise (texts).

    `declared` are those of the config; an ImuloopError where one is no unit.
    """
    used, doubts = {}, []
    stamps = log.found.get("time")
    if list in map(type, [stamps, *(stamps.values() if isinstance(stamps, dict) else ())]):
        # two columns are joined to ns, whatever is declared of them
        declared = declared | {"time": "ns"}
    for quantity, known in UNITS.items():
        unit = used[quantity] = declared.get(quantity) or log.units.get(quantity) or known[0]
        if log.units.get(quantity, unit) != unit:
            stated = log.units[quantity]
            doubts.append(f"units.{quantity} is {unit}, the log says {stated}; {unit} used")
        # that of sensors is checked with their scale; ISO 8601 stamps need no unit
        if unit in known or (quantity == "time" and is_iso(unit)):
            continue
        if quantity not in declared:
            # of time only where stamps are numbers
            if quantity != "time":
                raise unknown_unit(quantity, unit)
        elif quantity not in SENSORS:
            near = stated_unit(quantity, unit)
            hint = f"did you mean '{near}'?" if near else f"use one of {', '.join(known)}"
            raise ImuloopError(f"units.{quantity}: '{unit}' is not a unit; {hint}")
    if not log.temperature:
        del used["temperature"]
    if "interval" not in log.found:
        del used["interval"]
    return used, doubts


def _files(paths):
    """Return the files at paths; of a folder, those in it."""
    files = []
    for path in paths:
        files += sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
    return files


def _state(paths):
    """Return what differs once a file is written to or another takes its place."""
    found = []
    for path in _files(paths):
        # one that is gone differs, too
        with suppress(FileNotFoundError):
            state = path.stat()
            found.append((path, state.st_ino, state.st_size, state.st_mtime_ns))
    return found


def _hashes(paths):
    """Return file name (path, where names repeat) -> SHA-256; of a folder, its files."""
    files, found = _files(paths), {}
    distinct = len({path.name for path in files}) == len(files)
    for path in files:
        # one that is gone meanwhile has changed
        with suppress(FileNotFoundError):
            found[path.name if distinct else str(path)] = sha256(path)
    return found
