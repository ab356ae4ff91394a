"""One raw log into canonical samples and its quality figures."""

import os
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError, MachineFault, RejectedLog
from imuloop.core.files import replaced, write_json
from imuloop.core.samples import CHANNELS, TEMPERATURE, TIME, schema
from imuloop.core.units import STANDARD_GRAVITY, raw_unit
from imuloop.ingest import checks, clocks, even_stamps, increments, quality, reference
from imuloop.ingest import pps as marks
from imuloop.ingest.convert import Counts, all_rows, no_samples, si_samples
from imuloop.ingest.formats import find_format
from imuloop.ingest.places import PAIR, for_reader, in_config
from imuloop.ingest.plausible import milliseconds
from imuloop.ingest.raw_log import RawLog, absent_sensor
from imuloop.ingest.sources import sha256
from imuloop.ingest.spellings import SENSORS, UNITS, is_iso, stated_unit, unknown_unit
from imuloop.ingest.stamps import iso_text

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


def ingest(
    *,
    device,
    session,
    kind,
    paths,
    samples_path,
    quality_path,
    declared=None,
):
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
    declared = declared or Declared()
    paths = [Path(path) for path in paths]
    roles = declared.sources or (["log"] if len(paths) == 1 else SENSORS)
    files = dict(zip(roles, paths, strict=True))
    marks_file = files.pop("pps", None)
    reference_file = files.pop("reference", files.get("log"))
    columns, rate, full_scale = dict(declared.columns), declared.rate, declared.full_scale
    if declared.pps and not marks_file:
        columns["pps"] = declared.pps
    rejected = timeline = logged = even = usual = absent = wrong_unit = None
    reasons, counts = [], Counts()

    def measured():
        return _without(absent, quality.measure(samples, raw_units, full_scale))

    try:
        _check_paths(paths)
        before = _state(paths)
        log_format, form = find_format(declared.format, files)
        try:
            log = form.read(files, columns or None)
            absent = absent_sensor(log, columns)
        except RejectedLog as error:
            log, rejected = RawLog(), error
        units, doubts = used_units(log, declared.units)
        raw_units = used_raw_units(log, units, declared.nominal)
        source = declared.sources or {role: {"path": str(p)} for role, p in files.items()}
        origin = _origin(device, session, kind, units, raw_units, log_format, source)
        origin |= {"sha256": _hashes(paths), "simulated": log.simulated}
        origin |= {"declared": declared.of_log(), "sensor_ids": log.sensor_ids}
        if declared.known_rotation:
            origin["known_rotation"] = declared.known_rotation
        how = {"units": units, "raw_units": raw_units, "rate": rate}
        how["time_range"] = declared.time_range
        try:
            if rejected:
                raise rejected
            rows = all_rows(log, units, rate)
            if declared.pps or marks_file:
                timeline = marks.find_timeline(rows, log, units, declared.pps, marks_file)
                how["timeline"] = timeline
            if increments.by_stamps(log, units):
                # the usual step has to be known before gaps are
                usual = increments.usual_step(si_samples(rows, log, **how, counts=Counts())[TIME])
                how["usual"] = usual
            samples = si_samples(rows, log, **how, counts=counts)
            figures = measured()
            unstated = not ("time" in declared.units or "time" in log.units or counts.start_ns)
            if unstated and counts.time_unit == "s":
                wrong_unit = milliseconds(samples, figures, counts.points, rate)
            summed = bool(increments.factors(units))
            packets = even_stamps.packet_step(counts, rate) or even_stamps.packet_step(counts)
            even = even_stamps.even_samples(samples, counts, figures, rate, summed, packets)
            if even or packets:
                # once more, now that the line or the step is known
                as_logged, counts, logged = counts, Counts(), figures
                how |= {"even": even, "usual": None} if even else {"packets": packets}
                samples = si_samples(rows, log, **how, counts=counts)
                figures = measured()
        except RejectedLog as error:
            reasons, logged, samples = [str(error)], None, no_samples(log)
            figures = measured()
        if counts.start_ns is not None:
            origin["start"] = iso_text(counts.start_ns)
        if counts.time_unit:
            origin["units"]["time"] = counts.time_unit
        fault = even_stamps.broken(figures, rate)
        many = figures["gaps"]["count"] > even_stamps.MOST_BURSTS
        dropped, at = figures.pop("isolated")
        if len(dropped):
            counts.spiked = len(np.unique(dropped))
            number = np.bincount(at, minlength=len(CHANNELS)).tolist()
            counts.spike_values = dict(zip(CHANNELS, number, strict=True))
            samples = {name: np.delete(x, dropped) for name, x in samples.items()}
            # the gaps that this leaves are counted as spikes
            gaps = {"gaps": figures["gaps"]}
            figures = measured() | gaps
            del figures["isolated"]
        known = {"rails": quality.rails(figures, full_scale), "stuck": quality.stuck(figures)}
        origin |= {name: each for name, each in known.items() if each}
        if _state(paths) != before:
            reasons = ["the file changed while it was read"]
        wrong, doubted = [], []
        # without an accelerometer there is no yardstick
        gravity = None if absent == "acceleration" else declared.gravity
        units_and_kind = raw_units, gravity, kind, declared.nominal
        found = checks.findings(checks.Evidence(figures, counts, log, *units_and_kind, rate))
        wrong, doubted = found[checks.MISDECLARED], found[checks.DOUBTFUL]
        if fault:
            # the rate is wrong, and what was found by it
            wrong, doubted = ([fault], []) if many else ([], [fault])
        if wrong_unit:
            wrong.append(wrong_unit)
        if unread := found[checks.UNREADABLE]:
            reasons, wrong, doubted, logged = reasons or unread, [], [], None
        reasons = reasons or found[checks.UNUSABLE]
        if declared.reference and not (reasons or wrong):
            own = declared.of_log() | {"units": units}
            both = reference_file, files.get("log")
            columns, beside, wrong = reference.beside(
                samples, *both, declared.reference, own, counts
            )
            origin["reference"] = beside
            samples |= columns
        misdeclared = bool(wrong and not reasons)
        reasons = reasons or wrong
        _write(samples_path, no_samples(log) if reasons else samples, origin)
    except (ImuloopError, PermissionError) as error:
        names = ", ".join(os.fsencode(path).decode(errors="backslashreplace") for path in paths)
        kind_of_error, text = type(error), error
        if isinstance(error, PermissionError):
            kind_of_error, text = MachineFault, error.strerror
        whose = f"{device}/{session}: " if in_config() else ""
        raise kind_of_error(for_reader(f"{whose}{names}: {text}")) from error
    if timeline:
        early, late = counts.outside_marks.tolist()
        timeline.figures.update(before=early, after=late)
        doubts += marks.warnings(timeline.figures)
    summed = increments.figures(log, units, counts, usual, even, rate)
    doubts += increments.warnings(summed, figures)
    if logged:
        doubts.append(even_stamps.rebuilt(logged, even, as_logged, packets))
    doubts += counts.clock.warnings()
    if absent:
        why = f"what needs it is not testable; give both files where another holds it, {PAIR}"
        doubts.append(f"the log holds no {absent}: {why}")
    doubts += log.notes + (found[checks.WARNING] if figures["rows"] else []) + doubted
    told = {
        "misdeclared": misdeclared,
        "warnings": [*map(for_reader, doubts)],
        "clock": clocks.figures(
            *(counts.clock, figures, "time" in log.found and rate, logged),
            timeline and timeline.figures,
        ),
        "increments": summed,
    }
    reasons = [*map(for_reader, reasons)]
    write_json(quality_path, _quality(reasons, figures, counts, log) | told | origin)


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


def _check_paths(paths):
    for path in paths:
        if any("\ud800" <= c <= "\udfff" for c in str(path)):
            raise ImuloopError("its name is no UTF-8: rename it")
        if not (path.is_file() or path.is_dir()):
            raise ImuloopError("there is no such file")


def _origin(device, session, kind, units, raw_units, log_format, source):
    """Return where samples come from, as far as it is known before the log is read."""
    return {
        "device": device,
        "session": session,
        "kind": kind,
        "log_format": log_format,
        "source": source,
        "sha256": {},
        "units": units,
        "raw_units": {quantity: vars(unit) for quantity, unit in raw_units.items()},
        "declared": {},
        "sensor_ids": {},
        "simulated": False,
        "start": None,
    }


def _quality(reasons, figures, counts, log):
    """Return the content of quality.json of a log of which nothing more is known."""
    return {
        "format": 1,
        "status": "rejected" if reasons else "ok",
        "reasons": reasons,
        # whether the entry, not the log, is what the reasons are about
        "misdeclared": False,
        "warnings": [],
        **figures,
        "clock": None,
        "increments": None,
        **{name: getattr(counts, name) for name in _COUNTED},
        "bad_lines": log.bad_lines,
        "rows_read": counts.read,
        "outside_time_range": counts.outside,
        "columns": log.found,
    }


def write_rejected(*, device, session, kind, samples_path, quality_path, reason):
    """Write samples without rows and a quality with the reason, for a log that does not fit.

    Parameters are as in `ingest`; the reason is about what is declared.
    """
    units = {quantity: known[0] for quantity, known in UNITS.items()}
    raw_units = {quantity: raw_unit(quantity, units[quantity]) for quantity in SENSORS}
    origin = _origin(device, session, kind, units, raw_units, None, {})
    samples = no_samples(RawLog())
    _write(samples_path, samples, origin)
    figures = quality.measure(samples, raw_units)
    del figures["isolated"]
    found = _quality([reason], figures, Counts(), RawLog()) | origin
    write_json(quality_path, found | {"misdeclared": True})


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


def used_raw_units(log, units, nominal):
    """Return the RawUnit of each sensor by its quantity.

    Takes the name of each unit, and the declared scales of counts, which go before the log's.
    """
    scales = {q: log.nominal.get(q, {}) | nominal.get(q, {}) for q in SENSORS}
    return {q: raw_unit(q, units[q], scales[q]) for q in SENSORS}


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
