"""What is wrong with the files of a session, as far as it can be seen before the run."""

import os
import re
from contextlib import suppress
from pathlib import Path

from imuloop.config import is_stored, sources
from imuloop.core.errors import ImuloopError, RejectedLog, nearest
from imuloop.ingest import delimited
from imuloop.ingest.convert import Counts, si_batches
from imuloop.ingest.formats import find_format
from imuloop.ingest.ingest import used_raw_units, used_units
from imuloop.ingest.pps import read_marks
from imuloop.ingest.raw_log import absent_sensor
from imuloop.ingest.reference import read_series
from imuloop.ingest.sources import file_name

# where the simulate rule puts a replica's log, relative to the working folder
SIMULATED = re.compile(r"data/simulated/([^/]+)/([^/]+)\.parquet")

# most bytes judged before the run of a log that is read as a whole, unless a fault is in them; the
# same of a text table
CHECKED, BEGINNING = 1 << 23, 1 << 13


def path_fault(path):
    """Return why Snakemake cannot have a path as it is written, or None."""
    if not path.isprintable() or path != path.strip():
        return f"{path!a} has a blank at an end or what cannot be printed; rename it"
    if re.search(r"\{.*\}", path):
        return f"{path}: in place of braces Snakemake puts the name of a device; rename it"
    return None


def prior_fault(path):
    """Return what is wrong with the file of a prior, as far as it can be seen before the run."""
    if text := path_fault(path):
        return text
    if Path(os.path.normpath(path)).parts[:1] == ("results",):
        return f"{path} is a result of this workflow; copy it to another folder"
    try:
        return None if Path(path).is_file() else _missing(path, {})
    except OSError as error:
        return f"cannot be read: {error.strerror}"


def marks_faults(marks, replicas):
    """Yield what is wrong with 1PPS marks, as far as it can be seen without the log."""
    if "file" not in marks:
        for key in {"counter", "time"} - {*marks}:
            yield ("pps", key), "missing; marks are two columns of the log, or a file"
        return
    path, text = _local_file(marks["file"], replicas, "table of marks")
    if text:
        yield ("pps", "file"), text
    elif path:
        try:
            read_marks(path, marks)
        except OSError as error:
            yield ("pps", "file"), f"{path} cannot be read: {error.strerror}"
        except ImuloopError as error:
            yield _keyed(error, r"pps\..*", ("pps", "file"))


def reference_faults(session, replicas):
    """Yield what is wrong with a session's reference, as far as it can be seen before the run."""
    reference = session["reference"]
    if session.get("kind") != "reference_motion":
        yield ("reference",), "only a session of kind reference_motion has one"
        return
    own = "file" in reference
    path, text = _local_file(
        reference["file"] if own else session.get("file", ""), replicas, "file"
    )
    if text and own:
        yield ("reference", "file"), text
    # what is wrong with the log itself is named with it
    if text or not path or Path(path).stat().st_size > CHECKED:
        return
    form = reference.get("format") if own else session.get("format")
    try:
        read_series(path, form, reference.get("columns") or {})
    except RejectedLog:
        # a fault of the data, for the job to find
        return
    except ImuloopError as error:
        text = re.sub(r"\Acolumns", "reference.columns", str(error))
        yield _keyed(text, r"reference.*", ("reference",))


def _local_file(file, replicas, what):
    """Return the path of a file that is here, None without, and what is wrong with it, or None."""
    source = sources(file).get("log", {})
    path = source.get("path")
    if text := path_fault(path or file_name(source)) if source else None:
        return None, text
    if path is None or is_stored(path):
        return None, None
    if Path(path).is_file():
        return path, None
    return None, _missing(path, replicas) or f"{path} is no {what}"


def _keyed(error, known, otherwise):
    """Return key and text of an error that names a key first, if that is a known one."""
    named, _, text = str(error).partition(": ")
    return (
        (tuple(named.split(".")), text) if re.fullmatch(known, named) else (otherwise, str(error))
    )


def file_faults(session, nominal, replicas, whole, marked):
    """Yield what is wrong with a session's file, as far as it can be seen before the run."""
    given = sources(session["file"])
    names = {role: source.get("path") or file_name(source) for role, source in given.items()}
    keys = {role: ("file", *(() if role == "log" else (role,))) for role in given}
    for role, name in names.items():
        text = path_fault(name)
        if not is_stored(name) and Path(os.path.normpath(name)).parts[:1] == ("results",):
            text = f"{name} is a result of this workflow; name the log that it came from"
        if text:
            yield keys[role], text
            return
    if len({*names.values()}) < len(names):
        yield ("file",), f"{names['acceleration']} is given for both sensors; each has its own file"
        return
    try:
        _, log_format = find_format(session.get("format"), names)
    except ImuloopError as error:
        yield ("file",), str(error)
        return
    except OSError as error:
        # a name too long, a folder that may not be entered
        yield ("file",), f"cannot be read: {error.strerror}"
        return
    local = [role for role, source in given.items() if not is_stored(source.get("path", "://"))]
    there = [role for role in local if Path(names[role]).is_file() or Path(names[role]).is_dir()]
    for role in local:
        if role not in there and (text := _missing(names[role], replicas)):
            yield keys[role], text
    if locked := [names[role] for role in there if not os.access(names[role], os.R_OK)]:
        yield ("file",), f"{locked[0]} cannot be read: permission denied"
    elif len(there) == len(given):
        for folder in (name for name in names.values() if Path(name).is_dir()):
            # each file of a folder is an input
            for text in filter(None, map(path_fault, sorted(os.listdir(folder)))):
                yield ("file",), f"in {folder}, {text}"
                return
        # what nobody foresaw in one log stops no other: its own job fails with it and says so
        with suppress(Exception):
            how = session, nominal, log_format
            beginning = _beginning(log_format, names)
            if not beginning or [*_log_faults(*how, beginning, whole and marked)]:
                yield from _log_faults(*how, names, whole and marked)


def _size(names):
    """Return the bytes of a session's files, those inside of folders too."""
    paths = [Path(name) for name in names.values()]
    files = [f for path in paths for f in (path.iterdir() if path.is_dir() else [path])]
    return sum(file.stat().st_size for file in files if file.is_file())


def _beginning(log_format, names):
    """Return what a text table begins with, in whole lines, by its role; None of others."""
    if log_format.read is not delimited.read or Path(names["log"]).is_dir():
        return None
    with open(names["log"], "rb") as file:
        text = file.read(BEGINNING)
    return {"log": text[: text.rfind(b"\n") + 1]} if b"\n" in text else None


def _log_faults(session, nominal, log_format, names, whole):
    """Yield which of the declared columns a log lacks, and what of the rest does not fit it."""
    declared, wrong = dict(session.get("columns") or {}), set()
    marks = session.get("pps") or {}
    if {"counter", "time"} == {*marks}:
        declared["pps"] = marks
    while True:
        try:
            log = _read(log_format, names, declared, 1 << 8)
            absent_sensor(log, declared)
            break
        except RejectedLog:
            # a fault of the data, for the job to find
            return
        except ImuloopError as error:
            quantity, _, text = str(error).removeprefix("columns.").partition(": ")
            key, name = ("columns", quantity), quantity
            if quantity.startswith("pps."):
                key, name = tuple(quantity.split(".")), "pps"
            elif quantity not in declared:
                # without a column that was declared wrongly, the log may well lack others
                if not wrong:
                    yield ("file",), str(error)
                return
            yield key, text
            # the others may be wrong too
            wrong.add(name)
            del declared[name]
    timed = "time" in {*log.found, *wrong}
    if "log" in names and not timed and "rate" not in session:
        where = f"{names['log']} has no time column of a usual name ({log.columns})"
        yield ("rate",), f"missing; {where}; give it, or name the column in columns.time"
    elif marks and "time" not in {*log.found, *wrong}:
        yield ("pps",), "the log has no time column, which is to be the local counter"
    elif "pps" in declared and "pps" not in log.found:
        yield ("pps",), "only tables hold columns of marks; name a file in pps.file"
    elif whole and not wrong and _fitting_fault(session, nominal, log):
        # stamps may be missing at first: what few rows show counts where it does for the job
        text = _fitting_fault(session, nominal, _read(log_format, names, declared, 1 << 16))
        if text:
            yield _keyed(text, r"time_range|units\.\w+", ("file",))


def _fitting_fault(session, nominal, log):
    """Return why units or range do not fit a log's first rows, or None."""
    try:
        units, _ = used_units(log, session.get("units") or {})
        raw_units = used_raw_units(log, units, nominal)
        declared = {key: session.get(key) for key in ("rate", "time_range")}
        if session.get("pps"):
            # dates are the marks', not the stamps'
            declared["time_range"] = None
        batches = si_batches(log, units=units, raw_units=raw_units, counts=Counts(), **declared)
        next(batches, None)
    except RejectedLog:
        return None
    except ImuloopError as error:
        return str(error)
    return None


def _read(log_format, names, declared, rows):
    """Return the log, of a large one the head where nothing is amiss in it."""
    if log_format.whole and _size(names) > CHECKED:
        # a stream that the head lacks may come later
        with suppress(ImuloopError):
            return log_format.read(names, declared, rows, most=CHECKED)
    return log_format.read(names, declared, rows)


def _missing(path, replicas):
    """Return why a local file cannot be had, or None if the workflow makes it."""
    if simulated := SIMULATED.fullmatch(os.path.normpath(path)):
        replica, session = simulated.groups()
        if replica not in replicas:
            return f"there is no replica '{replica}'{nearest(replica, replicas, 0.6)}"
        if session not in replicas[replica]:
            known = replicas[replica]
            return f"{replica} has no session '{session}'{nearest(session, known, 0.6)}"
        return None
    if Path(path).is_dir():
        return f"{path} is a folder, not a file"
    if Path(path).is_symlink() and not Path(path).exists():
        return f"{path} is a link that leads to no file"
    return f"{path} is not a regular file" if Path(path).exists() else f"there is no file {path}"
