"""One raw log into canonical samples and its quality figures."""

import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError, MachineFault, RejectedLog
from imuloop.core.files import replaced, write_json
from imuloop.core.samples import schema
from imuloop.core.units import (
    ACCELERATION,
    ANGULAR_RATE,
    INCREMENTS,
    STANDARD_GRAVITY,
    TEMPERATURE,
    TIME,
    raw_unit,
)
from imuloop.ingest import bursts, clocks, increments, quality
from imuloop.ingest import pps as marks
from imuloop.ingest.columns import stated_unit, unknown_unit
from imuloop.ingest.convert import Counts, si_batches
from imuloop.ingest.formats import find_format
from imuloop.ingest.plausible import judged
from imuloop.ingest.raw_log import RawLog, rechunked
from imuloop.ingest.sources import sha256
from imuloop.ingest.stamps import is_iso, iso_text

# rows a row group of samples.parquet: 8 columns of it are 8 MB
ROW_GROUP = 1 << 17
# a block of memory of so many bytes that is freed once makes the C library keep what is freed of
# smaller ones, instead of fetching every page of every column anew: half the time of a large log
_KEPT = 31 << 20
# units that are read
_KNOWN = {
    "time": (*TIME,),
    "interval": (*TIME,),
    "acceleration": (*ACCELERATION, "count", *INCREMENTS["acceleration"]),
    "angular_rate": (*ANGULAR_RATE, "count", *INCREMENTS["angular_rate"]),
    "temperature": (*TEMPERATURE,),
}
# units where neither the config nor the log says
_SI = {"time": "s", "acceleration": "m/s^2", "angular_rate": "rad/s", "temperature": "degC"}
_SI["interval"] = "s"


def ingest(
    *,
    device,
    session,
    kind,
    paths,
    samples_path,
    quality_path,
    format=None,
    sources=None,
    columns=None,
    units=None,
    rate=None,
    time_range=None,
    pps=None,
    nominal=None,
    full_scale=None,
    gravity=STANDARD_GRAVITY,
    batch_rows=1 << 16,
    threads=1,
    progress=None,
):
    """Write samples.parquet and quality.json of one session.

    What is wrong in the data is a result: `status` is ``rejected``, with reasons, and the samples
    are empty.

    Parameters
    ----------
    device, session : str
        Names.
    kind : str or None
        What was done with the device, where that is known.
    paths : list of path-like
        Files of the log, or its folder, in the order of `sources`.
    samples_path, quality_path : path-like
        Files to write, each in one step.
    format : str, optional
        Name in `imuloop.ingest.formats.FORMATS`; told from the files' names if None.
    sources : dict, optional
        Role of each file (``log``, or ``acceleration`` and ``angular_rate``) to its source, for
        the record; told from the number of paths if None.
    columns, units : dict, optional
        As in the config; what is not declared is told from the log, units else SI.
    rate : float, optional
        Hz, where the log has no time column.
    time_range : (start, end), optional
        Half-open crop: seconds from the log's first stamp, or ISO 8601; None is an open end.
    pps : dict, optional
        ``counter`` and ``time`` of 1PPS marks, columns of the log or of the source ``pps``.
    nominal : dict, optional
        Quantity to ``scale`` and ``offset`` of raw counts.
    full_scale : dict, optional
        ``acceleration`` (m/s^2) and ``angular_rate`` (rad/s).
    gravity : float
        Local gravity, m/s^2.
    batch_rows : int
        Rows read at once, about; changes nothing in the result.
    threads : int
        How many may work at once; changes nothing in the result.
    progress : callable, optional
        ``progress(what, done, total)``, called often while a text table is ``"read"``, and then
        ``"measured"``: bytes of its files.

    Raises
    ------
    ImuloopError
        If what is declared does not fit the log; one line with device, session and file.
    """
    np.empty(_KEPT, dtype=np.uint8)
    paths = [Path(path) for path in paths]
    roles = sources or (["log"] if len(paths) == 1 else ["acceleration", "angular_rate"])
    files = dict(zip(roles, paths, strict=True))
    marks_file = files.pop("pps", None)
    columns = dict(columns or {})
    if pps and not marks_file:
        columns["pps"] = pps
    counts, reasons, logged, step, usual = Counts(), [], None, None, None
    timeline = None
    try:
        for path in paths:
            if any("\ud800" <= c <= "\udfff" for c in str(path)):
                raise ImuloopError("its name is no UTF-8: rename it")
            if not (path.is_file() or path.is_dir()):
                raise ImuloopError("there is no such file; see file: in the config")
        before = _state(paths)
        total = sum(size for _, _, size, _ in before)
        name, form = find_format(format, files)
        try:
            log = form.read(files, columns or None, batch_rows)
        except RejectedLog as error:
            log, reasons = RawLog(batches=iter(()), temperature=False, found={}), [str(error)]
        units, doubts = used_units(log, units or {})
        raw_units = {
            quantity: raw_unit(quantity, units[quantity], (nominal or {}).get(quantity))
            for quantity in ("acceleration", "angular_rate")
        }
        origin = {
            "device": device,
            "session": session,
            "kind": kind,
            "log_format": name,
            "source": dict(sources or {role: {"path": str(p)} for role, p in files.items()}),
            "sha256": None,
            "units": units,
            "raw_units": {quantity: vars(unit) for quantity, unit in raw_units.items()},
            "simulated": log.simulated,
            "start": None,
        }
        declared = {"units": units, "raw_units": raw_units, "rate": rate, "time_range": time_range}
        if not reasons and (pps or marks_file):
            log.threads = threads
            try:
                timeline = marks.find_timeline(log, units, pps or {}, marks_file)
            except RejectedLog as error:
                reasons = [str(error)]
            log = form.read(files, columns or None, batch_rows)
        declared["timeline"] = timeline

        def read(position):
            if progress and position:
                progress("read", position, total)

        def measured(share):
            if progress:
                progress("measured", share * total, total)

        log.threads = threads
        samples = si_batches(log, **declared, counts=counts)
        with ThreadPoolExecutor(1) as pool, replaced(samples_path) as temporary:
            own = (origin, pool.submit(_hashes, paths), read)
            measure = partial(quality.measure, temporary, full_scale, threads, measured)
            try:
                if not reasons and increments.by_stamps(log, units):
                    # the usual step has to be known before gaps are
                    usual = increments.usual_step(si_batches(log, **declared, counts=Counts()))
                    log = form.read(files, columns or None, batch_rows)
                    log.threads = threads
                    samples = si_batches(log, **declared, counts=counts, usual=usual)
                _write(temporary, samples if not reasons else (), log, counts, *own)
                figures = measure()
                step = bursts.line_step(counts, figures, rate, bool(increments.factors(units)))
                if step and bursts.follows_stamps(temporary, step):
                    step = None
                if step:
                    # once more from the start, now that the line is known
                    counts, logged = Counts(), figures
                    log = form.read(files, columns or None, batch_rows)
                    log.threads = threads
                    samples = si_batches(log, **declared, counts=counts, step=step)
                    _write(temporary, samples, log, counts, *own, rebuilt=True)
                    figures = measure()
            except RejectedLog as error:
                reasons, logged = [str(error)], None
                _write(temporary, (), log, counts, *own)
                figures = measure()
            if _state(paths) != before:
                reasons = ["the file changed while it was read"]
            wrong, doubted = judged(figures, raw_units, gravity, kind)
            fault = bursts.broken(figures, rate)
            if fault:
                # the rate is wrong, and what was told by it
                many = figures["gaps"]["count"] > bursts.MOST_BURSTS
                wrong, doubted = ([fault], []) if many else ([], [fault])
            lost_share = log.lost_bytes / log.text_bytes if log.text_bytes else 0.0
            reasons = reasons or quality.reasons(figures, counts, log.bad_lines, lost_share)
            misdeclared = bool(wrong and not reasons)
            reasons = reasons or wrong
            if reasons:
                _write(temporary, (), log, counts, *own)
    except (ImuloopError, PermissionError) as error:
        names = ", ".join(os.fsencode(path).decode(errors="backslashreplace") for path in paths)
        fault, said = type(error), error
        if isinstance(error, PermissionError):
            fault, said = MachineFault, error.strerror
        raise fault(f"{device}/{session}: {names}: {said}") from error
    notes = quality.warnings(figures, counts, log, rate=rate) + doubted
    if timeline:
        before, after = counts.outside_marks.tolist()
        timeline.told.update(before=before, after=after)
        doubts += marks.warnings(timeline.told)
    summed = increments.figures(log, units, counts, usual, step, rate)
    doubts += increments.warnings(summed, figures, counts)
    clock = clocks.figures(counts.clock, figures, "time" in log.found and rate, logged)
    write_json(
        quality_path,
        {
            **_quality(reasons, figures, counts, log),
            "misdeclared": misdeclared,
            "warnings": doubts + counts.clock.warnings(logged, step) + notes,
            "clock": {**clock, "pps": timeline and timeline.told},
            "increments": summed,
            **origin,
        },
    )


def _quality(reasons, figures, counts, log):
    """Return the content of quality.json but for what is told of clock, units and source."""
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
        "duplicates": counts.duplicates,
        "out_of_order": counts.out_of_order,
        "non_finite": counts.non_finite,
        "missing_values": counts.missing_values,
        "impossible_values": counts.impossible_values,
        "bad_lines": log.bad_lines,
        "rows_read": counts.read,
        "outside_time_range": counts.outside,
        "treatment": quality.TREATMENT,
        "columns": log.found,
    }


def write_nothing(*, device, session, kind, samples_path, quality_path, why):
    """Write samples without rows and a quality that says why, for a log that could not be read.

    Parameters
    ----------
    device, session, kind, samples_path, quality_path
        As of `ingest`.
    why : (str, dict or None)
        Reason, and the content of the key ``failed``.
    """
    reason, failed = why
    log = RawLog(batches=iter(()), temperature=False, found={})
    si = {quantity: _SI[quantity] for quantity in ("acceleration", "angular_rate")}
    origin = {
        "device": device,
        "session": session,
        "kind": kind,
        "log_format": None,
        "source": {},
        "sha256": {},
        "units": dict(_SI),
        "raw_units": {quantity: vars(raw_unit(quantity, unit)) for quantity, unit in si.items()},
        "simulated": False,
        "start": None,
    }
    empty = schema(False, origin).empty_table()
    with replaced(samples_path) as temporary:
        pq.write_table(empty, temporary)
        figures = quality.measure(temporary)
    content = _quality([reason], figures, Counts(), log)
    write_json(quality_path, {**content, **origin, "failed": failed})


def _write(path, batches, log, counts, origin, hashes, progress, rebuilt=False):
    """Write samples as Parquet; `origin` learns hashes, start and time unit on the way."""
    plain = schema(log.temperature, {}, rebuilt).remove_metadata()
    tables = rechunked(batches, ROW_GROUP)
    first = next(tables, plain.empty_table()).select(plain.names)
    # what is known at the end only cannot be in an Arrow schema; doubles need none
    options = {"compression": "zstd", "store_schema": False, **_encodings(first)}
    with pq.ParquetWriter(path, plain, **options) as writer:
        for table in chain([first] if len(first) else [], tables):
            writer.write_table(table.select(plain.names), row_group_size=ROW_GROUP)
            progress(log.position)
        origin["sha256"] = hashes.result()
        if counts.start_ns is not None:
            origin["start"] = iso_text(counts.start_ns)
        if counts.time_unit:
            origin["units"]["time"] = counts.time_unit
        writer.add_key_value_metadata(schema(log.temperature, origin).metadata)


def _encodings(table):
    """Return how Parquet is to hold the columns: few values by number, else byte by byte."""
    few = [n for n in table.column_names if 4 * len(np.unique(table[n])) < len(table)]
    many = [name for name in table.column_names if name not in few]
    return {"use_dictionary": few, "use_byte_stream_split": many}


def used_units(log, declared):
    """Return the unit of each quantity, and where the log itself says otherwise.

    Parameters
    ----------
    log : RawLog
        Log being read.
    declared : dict
        Units of the config.

    Raises
    ------
    ImuloopError
        If one is no unit of time or temperature.
    """
    used, doubts, stated = {}, [], log.units
    for quantity, si in _SI.items():
        used[quantity] = declared.get(quantity) or stated.get(quantity) or si
        # of time only where stamps are numbers: in ISO 8601 they need no unit
        known = declared.get(quantity) or quantity == "time" or used[quantity] in _KNOWN[quantity]
        if not known:
            raise unknown_unit(quantity, used[quantity])
        if stated.get(quantity, used[quantity]) != used[quantity]:
            doubts.append(
                f"units.{quantity} is {used[quantity]}, the log says {stated[quantity]}; "
                f"{used[quantity]} used"
            )
    for quantity, known in (("time", TIME), ("temperature", TEMPERATURE), ("interval", TIME)):
        if quantity in declared and used[quantity] not in known and not is_iso(used[quantity]):
            near = stated_unit(quantity, used[quantity])
            hint = f"did you mean '{near}'?" if near else f"use one of {', '.join(known)}"
            raise ImuloopError(f"units.{quantity}: '{used[quantity]}' is not a unit; {hint}")
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
    files = _files(paths)
    distinct = len({path.name for path in files}) == len(files)
    return {path.name if distinct else str(path): _hash(path) for path in files}


def _hash(path):
    # one that is gone meanwhile has changed
    with suppress(FileNotFoundError):
        return sha256(path)
