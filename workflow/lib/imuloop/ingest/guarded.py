"""Readers in a process of its own: what a broken file does to a library ends there, in one line."""

import functools
import json
import math
import mmap
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
import weakref
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import pyarrow as pa

from imuloop.core import errors
from imuloop.ingest.raw_log import RawLog

# no log packs better than this
MOST_TIMES = 200
# memory that a reader may take, bytes: beside `MOST_TIMES` the file, which is at most `MOST_HELD`
# or so many times a large file
MEMORY, MOST_HELD, LARGE_TIMES = 512 << 20, 4 << 30, 16
# processor time that a reader may take, s, and s per byte of the file
SECONDS, SECONDS_PER_BYTE = 2, 10e-6
# longest that a reader may wait, as for a pipe that a file leads to, s; at least what its processor
# time takes where so many programs share a processor
WAITING, SHARING = 60, 10
# what may go wrong in a declaration or in the data
_FORESEEN = {kind.__name__: kind for kind in (errors.Lacking, errors.ImuloopError)}


def guarded(read):
    """Make a reader run in a process of its own, with limits of memory and of time.

    The reader's process ends with the file or with the last reference to the log. Whatever the
    reader raises that it did not foresee, and its death, become a `RejectedLog`, a `MachineFault`
    where it was killed from outside; files that it unpacks into the folder of temporary files are
    removed.
    """

    @functools.wraps(read)
    def apart(paths, columns=None, batch_rows=1 << 16, **options):
        given = {"paths": paths, "columns": columns, "batch_rows": batch_rows, **options}
        messages = _messages((read.__module__, read.__name__), given)
        log = RawLog(**next(messages)[0])
        # a log that is let go lets its reader go
        log.batches = _batches(weakref.ref(log), messages)
        return log

    return apart


def check_unpacked(packed, unpacked):
    """Refuse a file of `packed` bytes of which so far more than `MOST_TIMES` as many came out."""
    if unpacked > MOST_TIMES * packed:
        raise errors.RejectedLog(
            f"unpacked, the file is more than {MOST_TIMES} times its {packed} bytes: refused, "
            "no log packs so well"
        )


def cause(error):
    """Return what an error of a library says, short and on one line."""
    return errors.one_line(f"{type(error).__name__}: {error}")[:150]


def _batches(log, messages):
    """Give the batches of a log, which learns on the way what its reader learned."""
    for told, table in messages:
        if log():
            vars(log()).update(told)
        yield from table.to_batches()


def _messages(reader, given):
    """Give (attributes of the log, table) as the reader's process sends them."""
    path = Path(given["paths"]["log"])
    files = path.iterdir() if path.is_dir() else [path]
    size = sum(file.stat().st_size for file in files if file.is_file())
    memory = MEMORY + min(MOST_TIMES * size, max(MOST_HELD, LARGE_TIMES * size))
    seconds = math.ceil(SECONDS + SECONDS_PER_BYTE * size)
    waiting = max(WAITING, SHARING * seconds)
    with tempfile.TemporaryDirectory(prefix="imuloop-") as folder:
        own = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "TMPDIR": folder}
        own |= {"OPENBLAS_NUM_THREADS": "1", "ARROW_DEFAULT_MEMORY_POOL": "system"}
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **own},
            # Ctrl-C is for the program, which ends its readers
            process_group=0,
        )
        with process:
            try:
                with suppress(BrokenPipeError), process.stdin as pipe:
                    pickle.dump((reader, given, memory, seconds, waiting), pipe)
                source, told = pa.PythonFile(process.stdout), {}
                while not told.get("end"):
                    try:
                        table = pa.ipc.open_stream(source).read_all()
                    except (pa.ArrowException, OSError):
                        raise _death(process.wait(), path.name, seconds, waiting) from None
                    told = json.loads(table.schema.metadata[b"told"])
                    if "error" in told:
                        kind, text = told["error"]
                        raise _FORESEEN.get(kind, errors.RejectedLog)(text)
                    yield told.get("log", {}), table.replace_schema_metadata()
            finally:
                process.kill()


def _death(status, name, seconds, waiting):
    """Return the error of a reader that ended before its log."""
    if status > 0:
        return RuntimeError(f"the reader of {name} did not start: status {status}")
    # not every system has every signal
    ended = next((each.name for each in signal.Signals if each == -status), "")
    if ended == "SIGKILL":
        # its own limits end it otherwise
        return errors.MachineFault(
            f"the reader of {name} was killed from outside, as where the machine lacks memory: run "
            "again with less beside it"
        )
    why = {
        "SIGXCPU": f"takes more than {seconds} s of processor time to read",
        "SIGALRM": f"leads its reader to wait for more than {waiting} s",
    }.get(ended, f"ends the process that reads it by signal {-status}")
    return errors.RejectedLog(
        f"{name} {why}, as no log of its size does: it is damaged; copy it again, or save it anew"
    )


def serve():
    """Read the log that standard input names, and write it to standard output."""
    (module, name), given, memory, seconds, waiting = pickle.load(sys.stdin.buffer)
    out = os.fdopen(os.dup(1), "wb")
    read = getattr(import_module(module), name).__wrapped__
    # libraries print what they think of a file
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    used = math.ceil(time.process_time())
    with suppress(OSError):
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        _limit("RLIMIT_AS", memory + pages * mmap.PAGESIZE)
    _limit("RLIMIT_CPU", used + seconds)
    _limit("RLIMIT_FSIZE", memory)
    _limit("RLIMIT_CORE", 0)
    # Windows has no alarm
    alarm = getattr(signal, "alarm", lambda seconds: None)
    # words need memory too
    caught, reserve = None, bytearray(4 << 20)
    try:
        alarm(waiting)
        log = read(**given)
        _send(out, pa.record_batch({}), log=_told(log))
        for batch in log.batches:
            alarm(0)
            _send(out, batch)
            alarm(waiting)
        _send(out, pa.record_batch({}), log=_told(log), end=True)
    except Exception as error:
        del reserve
        caught = error
    if caught:
        _limit("RLIMIT_AS")
        form = module.rpartition(".")[2] if name == "read" else name.removeprefix("read_")
        _send(out, pa.record_batch({}), error=_words(caught, form, given["paths"]["log"], memory))


def _words(error, form, path, memory):
    """Return the name of an error that was foreseen, empty for others, and what to say of it."""
    name = Path(path).name
    if isinstance(error, errors.ImuloopError):
        return type(error).__name__, str(error)
    if isinstance(error, MemoryError):
        why = f"takes more than {memory >> 20} MB of memory to read, as no log of its size does"
        return "", f"{name} {why}: it is damaged, or no log"
    if isinstance(error, ImportError):
        package = str(error.name).partition(".")[0]
        why = f"format {form} needs the package {package}, which is not installed"
        # an extra of the project is called as the format that needs it
        return "ImuloopError", f"{why}: pip install '.[{form}]'"
    why = cause(error).replace(str(path), "the file")
    return "", (
        f"{name} is no whole file of the format {form} ({why}): copy it again, or save it anew"
    )


def _limit(name, most=None):
    """Limit what this process may take, as far as it is not limited further, or lift the limit.

    Where the system has no such limits, as Windows has none, a reader runs without.
    """
    try:
        import resource
    except ImportError:
        return
    kind = getattr(resource, name)
    _, hard = resource.getrlimit(kind)
    if most is None or (hard != resource.RLIM_INFINITY and hard < most):
        most = hard
    with suppress(ValueError, OSError):
        resource.setrlimit(kind, (most, hard))


def _told(log):
    """Return what is known of a log that was opened, which may have grown once it is read."""
    return {name: value for name, value in vars(log).items() if name != "batches"}


def _send(out, batch, **told):
    schema = batch.schema.with_metadata({"told": json.dumps(told)})
    with pa.ipc.new_stream(out, schema) as writer:
        writer.write_batch(batch.replace_schema_metadata(schema.metadata))
    out.flush()
