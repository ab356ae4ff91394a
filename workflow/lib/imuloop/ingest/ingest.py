"""From one raw log to its canonical samples and quality figures.

The steps are: read the files, find columns and units, find one clock, convert, check, write.
"""

import os
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError, MachineFault, RejectedLog, nearest
from imuloop.core.files import replaced, write_json
from imuloop.core.samples import CHANNELS, TEMPERATURE, TIME, schema
from imuloop.ingest import checks, clocks, even_stamps, increments, pps, quality, reference
from imuloop.ingest.columns import STAMP
from imuloop.ingest.convert import Counts, no_samples, si_samples
from imuloop.ingest.evidence import Declared, Evidence
from imuloop.ingest.formats import find_format
from imuloop.ingest.places import for_reader, in_config
from imuloop.ingest.raw_log import RawLog, absent_sensor
from imuloop.ingest.rows import Rows
from imuloop.ingest.sources import sha256
from imuloop.ingest.spellings import SENSORS, UNITS, is_iso, unknown_unit
from imuloop.ingest.spikes import without_spikes
from imuloop.ingest.stamps import iso_text

# rows of a row group in samples.parquet: 8 columns of a row group have 8 MB
ROW_GROUP = 1 << 17
_COUNTED = (
    *("duplicates", "identical", "out_of_order", "non_finite", "missing_values"),
    *("impossible_values", "spiked", "spike_values", "increments"),
)
# quantities that have a unit whether or not the log holds them
_WITH_UNIT = ("time", *SENSORS)


def ingest(*, device, session, kind, paths, samples_path, quality_path, declared=None):
    """Write samples.parquet and quality.json of one session from its log.

    A fault in the data is a result: quality.json then has the status ``rejected`` and the reasons,
    and samples.parquet has no rows. Each file appears at once, complete.

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
    paths = [Path(path) for path in paths]
    who = {"device": device, "session": session, "kind": kind}
    try:
        evidence = read(paths, declared or Declared(), kind)
        convert(evidence)
        _write(samples_path, quality_path, *check(evidence), who)
    except (ImuloopError, OSError) as error:
        names = ", ".join(os.fsencode(path).decode(errors="backslashreplace") for path in paths)
        fault, text = type(error), error
        if isinstance(error, OSError):
            fault, text = MachineFault, error.strerror or error
        whose = f"{device}/{session}: " if in_config() else ""
        raise fault(for_reader(f"{whose}{names}: {text}")) from error


def write_rejected(*, device, session, kind, samples_path, quality_path, reason):
    """Write the samples, without rows, and the quality of a session that is rejected.

    `reason` says why its declaration does not fit. `device` and `session` are the names of the
    device and the session, and `kind` is the kind of the session, such as ``static``.
    `samples_path` and `quality_path` are the paths of the results.
    """
    evidence = Evidence(samples=no_samples(RawLog()), counts=Counts(reasons=[reason]))
    samples, content, origin = check(evidence)
    who = {"device": device, "session": session, "kind": kind}
    _write(samples_path, quality_path, samples, content | {"misdeclared": True}, origin, who)


def read(paths, declared, kind=None):
    """Return the `Evidence` on a log after it is read, still without samples.

    `paths` are the files in the order of the sources of `declared`, the Declared of the log, and
    `kind` is the kind of the session. Raises an ImuloopError if a file does not exist, or if a
    declaration does not fit.
    """
    for path in paths:
        if any("\ud800" <= c <= "\udfff" for c in str(path)):
            raise ImuloopError("its name is no UTF-8: rename it")
        if not (path.is_file() or path.is_dir()):
            raise ImuloopError("there is no such file")
    roles = declared.sources or (["log"] if len(paths) == 1 else SENSORS)
    files = dict(zip(roles, paths, strict=True))
    evidence = Evidence(declared, kind, files, declared.format)
    in_log = declared.pps and "pps" not in files
    columns = declared.columns | ({"pps": declared.pps} if in_log else {})
    try:
        evidence.format, reader = find_format(declared.format, evidence.of_log)
        log = evidence.log = reader(evidence.of_log, columns or None)
        empty = "time" in log.names and log.batch[STAMP].null_count == log.batch.num_rows
        if empty and declared.rate and "time" not in columns:
            # the rate is enough
            log.batch = log.batch.drop_columns([STAMP])
            del log.names["time"]
        evidence.absent = absent_sensor(evidence.log, columns)
    except RejectedLog as error:
        evidence.log, evidence.counts.reasons = RawLog(), [str(error)]
    evidence.units, evidence.doubts = choose_units(evidence.log, declared.units)
    return evidence


def choose_units(log, declared):
    """Return the unit of each quantity in a log, a dict, and lines on contradictions, a list.

    `log` is the RawLog. `declared` are the declared units by quantity; they come before the units
    that the log states. A contradiction is a declared unit that differs from the stated one; a line
    is for the user. Raises an ImuloopError for an unknown unit.
    """
    stamps = log.names.get("time")
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
            hint = nearest(unit, UNITS[quantity])
            raise ImuloopError(f"units.{quantity}: '{unit}' is not a unit{hint}")
    doubts = [
        f"units.{quantity} is {unit}, the log says {stated}; {unit} used"
        for quantity, unit in used.items()
        if (stated := log.units.get(quantity, unit)) != unit
    ]
    return {q: u for q, u in used.items() if q in _WITH_UNIT or q in log.names}, doubts


def convert(evidence):
    """Set the samples and the counts of a log in its `Evidence`, `evidence`, in place.

    The samples are in SI on one clock; spikes are still in them. A log that cannot be used has no
    samples; its `Counts` have the reasons.
    """
    log, counts = evidence.log, evidence.counts
    evidence.samples, counts.read = no_samples(log), log.batch.num_rows
    if counts.reasons:
        return
    try:
        rows = Rows(log, evidence.units, evidence.declared)
        if counts.read:
            rows.find_clock(evidence.files.get("pps"))
            evidence.samples, counts = si_samples(rows, evidence.raw_units)
    except RejectedLog as error:
        counts.reasons = [str(error)]
    else:
        if rows.logged is not None:
            counts.logged = quality.time_figures(rows.logged)
            del counts.logged["rows"]
            counts.rebuilt = even_stamps.rebuilt_line(rows)
        evidence.counts = counts


def check(evidence):
    """Return the samples of a log without spikes, the content of quality.json, and the origin.

    `evidence` is the Evidence on the log, after `convert`; its samples and figures are set. The
    first result is a dict of columns by name, without rows if the log is rejected. The second is a
    dict, the text of quality.json. The third is the metadata of the samples, a dict as `_origin`
    returns it.
    """
    log, counts, declared = evidence.log, evidence.counts, evidence.declared
    gaps = quality.time_figures(evidence.samples[TIME])["gaps"]
    samples, counts.spike_values, shared = without_spikes(evidence.samples)
    counts.spiked = len(evidence.samples[TIME]) - len(samples[TIME])
    figures = quality.measure(samples, evidence.raw_units, declared.full_scale, evidence.absent)
    # a row that is dropped for a spike leaves no gap
    figures["gaps"] = gaps
    if figures["faults"]:
        figures["faults"]["spikes"] = shared
    evidence.samples, evidence.figures = samples, figures
    findings = checks.findings(evidence)
    reasons = findings[checks.UNREADABLE] or findings[checks.UNUSABLE]
    wrong, origin = findings[checks.MISDECLARED], _origin(evidence)
    if declared.reference and not (reasons or wrong):
        session = declared.of_log() | {"units": origin["units"]}
        columns, origin["reference"], wrong = reference.beside(
            samples, evidence.files, declared.reference, session, counts
        )
        samples = samples | columns
    lines = [
        *evidence.doubts,
        *pps.warnings(counts.pps),
        *increments.warnings(counts.increments, figures),
        *([counts.rebuilt] if counts.rebuilt else []),
        *counts.clock.warnings(),
        *log.notes,
        *findings[checks.WARNING],
        *findings[checks.DOUBTFUL],
    ]
    content = {
        "format": 1,
        "status": "rejected" if reasons or wrong else "ok",
        "reasons": [*map(for_reader, reasons or wrong)],
        # whether the reasons are about the declaration in the config, not about the log
        "misdeclared": bool(wrong and not reasons),
        "warnings": [] if findings[checks.UNREADABLE] else [*map(for_reader, lines)],
        **figures,
        "clock": clocks.figures(counts, figures, declared.rate if "time" in log.names else None),
        **{name: getattr(counts, name) for name in _COUNTED},
        "bad_lines": log.bad_lines,
        "rows_read": counts.read,
        "outside_time_range": counts.outside,
        "columns": log.names,
    }
    return no_samples(log) if reasons or wrong else samples, content, origin


def _origin(evidence):
    """Return the metadata of the samples of a log, a dict: its files, units and so on.

    `evidence` is the Evidence on the log. Files are named with their SHA-256.
    """
    declared, counts = evidence.declared, evidence.counts
    # a folder stands for the files in it
    folders = [sorted(p.iterdir()) if p.is_dir() else [p] for p in evidence.files.values()]
    paths = [path for folder in folders for path in folder if path.is_file()]
    distinct = len({path.name for path in paths}) == len(paths)
    start, paths_of = counts.start_ns, evidence.of_log.items()
    origin = {
        "log_format": evidence.format,
        "source": declared.sources or {role: {"path": str(path)} for role, path in paths_of},
        # if two files have the same name, their paths are the keys
        "sha256": {p.name if distinct else str(p): sha256(p) for p in paths},
        "raw_units": {quantity: vars(unit) for quantity, unit in evidence.raw_units.items()},
        "declared": declared.of_log(),
        "sensor_ids": evidence.log.sensor_ids,
        "simulated": evidence.log.simulated,
        "start": None if start is None else iso_text(start),
        "units": evidence.units | ({"time": counts.time_unit} if counts.time_unit else {}),
    }
    where_any = {
        "known_rotation": declared.known_rotation,
        "rails": quality.rails(evidence.figures, declared.full_scale),
        "stuck": quality.stuck(evidence.figures),
    }
    return origin | {name: value for name, value in where_any.items() if value}


def _write(samples_path, quality_path, samples, content, origin, who):
    """Write the samples and the quality of a session to `samples_path` and `quality_path`.

    `samples`, `content` and `origin` are the results of `check`. `who` is a dict of the names of
    the device and the session, and its kind. Channels are written with dictionary encoding, because
    they have few different values; times are not.
    """
    origin = who | origin
    of_levels = [name for name in samples if name in (*CHANNELS, TEMPERATURE)]
    table, how = pa.table(samples), {"compression": "zstd", "use_dictionary": of_levels}
    how["use_byte_stream_split"] = [name for name in samples if name not in of_levels]
    with replaced(samples_path) as temporary:
        # a table of float64 can be read without a stored schema of Arrow
        with pq.ParquetWriter(temporary, table.schema, store_schema=False, **how) as writer:
            writer.write_table(table, row_group_size=ROW_GROUP)
            writer.add_key_value_metadata(schema(origin).metadata)
    write_json(quality_path, content | origin)
