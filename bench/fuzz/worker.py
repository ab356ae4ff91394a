"""A process that reads cases within limits, and sees what they do elsewhere."""

import json
import os
import shutil
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import yaml

from bench.fuzz.cases import case
from bench.fuzz.processes import MEMORY, confine
from bench.fuzz.seeds import ROWS, SIX
from imuloop.config import resolve
from imuloop.config_faults import config_faults, unreadable
from imuloop.core.errors import ImuloopError
from imuloop.ingest.ingest import Declared, ingest

REPOSITORY = Path(__file__).resolve().parents[2]
SCHEMA = REPOSITORY / "workflow/schemas/config.schema.yaml"
# events of Python that no log may cause
FORBIDDEN = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "socket.")
FORBIDDEN += ("pickle.", "ctypes.dlopen", "webbrowser.", "ftplib.", "urllib.")
# but for the process of a reader
READER = "from imuloop.ingest.guarded import serve; serve()"
# those that change the files that they name
CHANGES = ("os.remove", "os.mkdir", "os.rmdir", "os.truncate", "os.chmod", "os.chown", "os.utime")
CHANGES += ("os.symlink", "os.link", "os.rename", "shutil.rmtree")
# what lies beside a config
BESIDE = {"a.mat": b"0 0 0 9.8\n" * ROWS, "b.mat": b"0 0 0 9.8\n" * ROWS}
RESULTS = {"out/samples.parquet", "out/quality.json"}


def serve(pipe, numbers, seeds, folder):
    """Answer cases, within a limit of memory; see what is written or run elsewhere.

    Python tells what it opens for writing. A library in C does not: its current folder, home and
    place of temporary files are inside of the worker's folder, in which nothing else may appear.
    """
    # numbers near the largest overflow; what counts is the results
    warnings.simplefilter("ignore")
    folder = Path(tempfile.mkdtemp(dir=folder))
    work, home = folder / "a/work", folder / "home"
    os.environ |= dict.fromkeys(("HOME", "TMPDIR", "SQLITE_TMPDIR"), str(home))
    tempfile.tempdir = str(work)
    # libraries print on broken files
    confine()
    outside, watching = [], False

    def watch(event, arguments):
        reader = event == "subprocess.Popen" and READER in arguments[1]
        if not watching or reader:
            return
        if event.startswith(FORBIDDEN) and event not in CHANGES:
            outside.append(f"{event} {arguments}"[:300])
        writing = event == "open" and arguments[2] & (os.O_WRONLY | os.O_RDWR)
        paths = arguments[:1] if writing else arguments[:2] if event in CHANGES else ()
        # a number is a file that is open already
        for path in (os.fsdecode(each) for each in paths if isinstance(each, (str, bytes))):
            real = os.path.realpath(os.path.dirname(path) or ".")
            if not f"{real}{os.sep}".startswith(f"{work}{os.sep}") and path != os.devnull:
                outside.append(f"{event} {os.path.abspath(path)}")

    sys.addaudithook(watch)
    for number in numbers:
        # a reader's process that ends just now removes what it had here itself
        shutil.rmtree(folder, ignore_errors=True)
        work.mkdir(parents=True, exist_ok=True)
        home.mkdir(exist_ok=True)
        os.chdir(work)
        kind, name, content, declared = case(number, seeds)
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
            frames = traceback.extract_tb(error.__traceback__)[-4:]
            where = " ".join(f"{Path(f.filename).name}:{f.lineno}" for f in frames)
            end, fault = "traceback", f"{type(error).__name__} {error} ({where})"
        watching = False
        # passes over a folder that goes while it is looked through, unlike rglob
        found = {
            os.path.relpath(os.path.join(at, file), folder)
            for at, _, files in os.walk(folder)
            for file in files
        }
        if left := found - {f"a/work/{path}" for path in {*given, *RESULTS}}:
            fault = fault or f"left behind {sorted(left)}"
        fault = fault or next(iter(outside), None)
        pipe.send((end, [fault] if fault else []))


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
            declared=Declared(**declared),
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
    if reported := unreadable(name):
        return "unreadable", None if reported.isprintable() else reported
    config = yaml.safe_load(Path(name).read_text(encoding="utf-8"))
    found = config_faults(config, {name: name}, SCHEMA, {"iphone_6": ["static"]})
    if not found:
        resolve(config)
    return ("faults" if found else "ok"), next((x for x in found if not x.isprintable()), None)
