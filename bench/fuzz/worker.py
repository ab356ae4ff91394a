"""A process that makes and reads cases within limits, and sees what they do elsewhere."""

import json
import multiprocessing
import os
import resource
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from bench.fuzz.cases import case
from bench.fuzz.seeds import ROWS, SIX
from imuloop.config import resolve
from imuloop.config_faults import config_faults, unreadable
from imuloop.core.errors import ImuloopError
from imuloop.ingest.ingest import ingest

REPOSITORY = Path(__file__).resolve().parents[2]
SCHEMA = REPOSITORY / "workflow/schemas/config.schema.yaml"
# s, bytes
SECONDS, MEMORY = 10, 1 << 30
# events of Python that no log may cause
FORBIDDEN = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "socket.")
FORBIDDEN += ("pickle.", "shutil.", "ctypes.dlopen", "webbrowser.", "ftplib.", "urllib.")
# but for the process of a reader
READER = "from imuloop.ingest.guarded import serve; serve()"
# those that change a path, and which of their arguments are paths
CHANGES = dict.fromkeys("os.remove os.mkdir os.rmdir os.truncate os.chmod os.chown".split(), (0,))
CHANGES |= {
    "os.utime": (0,),
    "shutil.rmtree": (0,),
    "os.symlink": (1,),
    "os.link": (1,),
    "os.rename": (0, 1),
}
# what lies beside a config
BESIDE = {"a.mat": b"0 0 0 9.8\n" * ROWS, "b.mat": b"0 0 0 9.8\n" * ROWS}
RESULTS = {"out/samples.parquet", "out/quality.json"}


class Worker:
    """A process that judges cases by their numbers, in a folder of its own.

    Parameters
    ----------
    folder : Path
        Its own.
    serve : callable
        What it does: takes the end of a pipe that gives numbers and wants an end and a fault or
        None for each, the folder, where to tell the kind of a case, and the arguments.
    *arguments
        Of `serve`.
    """

    def __init__(self, folder, serve, *arguments):
        context = multiprocessing.get_context("fork")
        self.folder, self.kind = folder, context.Array("c", 16)
        self.pipe, other = context.Pipe()
        arguments = (other, folder, self.kind, *arguments)
        self.process = context.Process(target=serve, args=arguments, daemon=True)
        self.process.start()
        other.close()

    def start(self, number):
        """Begin a case."""
        self.number, self.began = number, time.monotonic()
        self.kind.value = b"(none)"
        self.pipe.send(number)

    def end(self, done, limit):
        """Return kind and end of the case, and its fault or None; one not done is stopped."""
        kind = self.kind.value.decode()
        if not done:
            self.stop()
            return kind, "hang", f"not done within {limit} s"
        try:
            return kind, *self.pipe.recv()
        except EOFError:
            self.process.join()
            return kind, "crash", f"the process ended with {self.process.exitcode}"

    def stop(self):
        self.process.kill()
        self.process.join()


def serve(pipe, folder, told, seeds):
    """Answer cases, within a limit of memory; tell what is written or run elsewhere.

    Python tells what it opens for writing. A library in C does not: its current folder, home and
    place of temporary files are inside of the worker's folder, in which nothing else may appear.
    """
    sys.dont_write_bytecode = True
    # numbers near the largest overflow; what counts is the results
    warnings.simplefilter("ignore")
    quiet = os.open(os.devnull, os.O_WRONLY)
    # libraries print on broken files
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    shutil.rmtree(folder, ignore_errors=True)
    work, home = folder / "a/work", folder / "home"
    home.mkdir(parents=True)
    os.environ |= dict.fromkeys(("HOME", "TMPDIR", "SQLITE_TMPDIR"), str(home))
    tempfile.tempdir = str(work)
    # threads for tables of a few rows cost more than they save
    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)
    # the schema is the same in each case, and takes longest
    text, load = SCHEMA.read_text(), yaml.load
    schema = load(text, yaml.SafeLoader)
    yaml.load = lambda content, loader: schema if content == text else load(content, loader)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    inside, outside, watching = f"{work}{os.sep}", [], False

    def watch(event, arguments):
        if not watching:
            return
        if event == "open":
            path, _, flags = arguments
            if not isinstance(path, (str, bytes)) or not flags & (os.O_WRONLY | os.O_RDWR):
                return
            paths = [path]
        elif event in CHANGES:
            paths = [arguments[i] for i in CHANGES[event]]
        elif event == "subprocess.Popen" and READER in arguments[1]:
            return
        elif event.startswith(FORBIDDEN):
            outside.append(f"{event} {arguments}"[:300])
            return
        else:
            return
        # a number is a file that is open already
        for path in (os.fsdecode(each) for each in paths if not isinstance(each, int)):
            real = os.path.realpath(os.path.dirname(path) or ".")
            if not f"{real}{os.sep}".startswith(inside) and path != os.devnull:
                outside.append(f"{event} {os.path.abspath(path)}")

    sys.addaudithook(watch)
    while True:
        number = pipe.recv()
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        os.chdir(work)
        kind, name, content, declared = case(number, seeds)
        told.value = kind.encode()
        given = {name: content}
        if kind == "config":
            given |= {"log.csv": seeds["csv"][0][1] if "csv" in seeds else b"", **BESIDE}
        for path, each in given.items():
            Path(path).write_bytes(each)
        outside.clear()
        watching = True
        try:
            end, fault = judge_config(name) if kind == "config" else judge_log(name, declared)
        except MemoryError:
            end, fault = "memory", f"more than {MEMORY >> 30} GB"
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            where = [f"{Path(f.filename).name}:{f.lineno}" for f in frames]
            end, fault = "traceback", f"{type(error).__name__} {error} ({' '.join(where[-4:])})"
        watching = False
        left = files(folder) - {f"a/work/{path}" for path in {*given, *RESULTS}}
        if left:
            fault = fault or f"left behind {sorted(left)}"
            shutil.rmtree(home)
            home.mkdir()
        pipe.send((end, fault or (outside and outside[0]) or None))


def files(folder):
    """Return the paths below a folder of all that is no folder."""
    found, folders = set(), [""]
    while folders:
        below = folders.pop()
        with os.scandir(folder / below) as entries:
            for entry in entries:
                path = f"{below}{entry.name}"
                if entry.is_dir(follow_symlinks=False):
                    folders.append(f"{path}/")
                else:
                    found.add(path)
    return found


def judge_log(name, declared):
    """Return how a log was read, and what is wrong with its results."""
    try:
        ingest(
            device="imu",
            session="a",
            kind="static",
            paths=[name],
            samples_path="out/samples.parquet",
            quality_path="out/quality.json",
            **declared,
        )
    except ImuloopError as error:
        return "declared", None if str(error) else "no words"
    quality = json.loads(Path("out/quality.json").read_text())
    with pq.ParquetFile("out/samples.parquet") as file:
        t, *six = (column.to_numpy() for column in file.read(["t", *SIX]).columns)
    if quality["status"] == "rejected":
        sound = not len(t) and quality["reasons"]
    else:
        sound = t[0] == 0 and (np.diff(t) > 0).all() and np.isfinite(six).all()
    return quality["status"], None if sound else "the results are not sound"


def judge_config(name):
    """Return whether a config has faults, and what is wrong with their lines."""
    if told := unreadable(name):
        return "unreadable", None if told.isprintable() else told
    config = yaml.safe_load(Path(name).read_text(encoding="utf-8"))
    found = config_faults(config, {name: name}, SCHEMA, {"iphone_6": ["static"]})
    if not found:
        resolve(config)
    return ("faults" if found else "ok"), next((x for x in found if not x.isprintable()), None)
