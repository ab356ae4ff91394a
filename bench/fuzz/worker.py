"""A process that reads cases within limits, and sees what they do elsewhere."""

import multiprocessing
import os
import resource
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

import numpy as np
import yaml

from bench.fuzz.seeds import SIX
from imuloop.config import resolve
from imuloop.config_faults import config_faults, unreadable
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json
from imuloop.core.samples import read_samples
from imuloop.ingest.ingest import ingest

REPOSITORY = Path(__file__).resolve().parents[2]
# s, bytes
SECONDS, MEMORY = 10, 2 << 30
# events of Python that no log may cause
FORBIDDEN = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "socket.")
FORBIDDEN += ("pickle.", "shutil.", "ctypes.dlopen", "webbrowser.", "ftplib.", "urllib.")
CHANGES = ("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.chmod")


class Worker:
    """A process that reads cases in a folder."""

    def __init__(self, folder):
        context = multiprocessing.get_context("fork")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=serve, args=(other, folder), daemon=True)
        self.process.start()
        other.close()

    def run(self, name, declared):
        """Return how a case ended, and its fault or None."""
        self.pipe.send((name, declared))
        if not self.pipe.poll(SECONDS):
            self.stop()
            return "hang", f"not done within {SECONDS} s"
        try:
            return self.pipe.recv()
        except EOFError:
            self.process.join()
            return "crash", f"the process ended with {self.process.exitcode}"

    def lives(self):
        return self.process.is_alive()

    def stop(self):
        self.process.kill()
        self.process.join()


def serve(pipe, folder):
    """Answer cases, within a limit of memory; tell what is written or run elsewhere."""
    sys.dont_write_bytecode = True
    # numbers near the largest overflow; what counts is the results
    warnings.simplefilter("ignore")
    quiet = os.open(os.devnull, os.O_WRONLY)
    # libraries print on broken files
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    tempfile.tempdir = str(folder)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    inside, outside = f"{folder}{os.sep}", []

    def watch(event, arguments):
        if event == "open":
            path, _, flags = arguments
            if not isinstance(path, (str, bytes)) or not flags & (os.O_WRONLY | os.O_RDWR):
                return
        elif event in CHANGES:
            path = arguments[0]
        elif event.startswith(FORBIDDEN):
            outside.append(f"{event} {arguments}"[:300])
            return
        else:
            return
        path = os.path.abspath(os.fsdecode(path))
        if not f"{path}{os.sep}".startswith(inside) and path != os.devnull:
            outside.append(f"{event} {path}")

    sys.addaudithook(watch)
    while True:
        name, declared = pipe.recv()
        # the folder is made anew for each case
        os.chdir(folder)
        outside.clear()
        try:
            end, fault = judge_config(name) if name == "config.yaml" else judge_log(name, declared)
        except MemoryError:
            end, fault = "memory", f"more than {MEMORY >> 30} GB"
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            where = [f"{Path(f.filename).name}:{f.lineno}" for f in frames]
            end, fault = "traceback", f"{type(error).__name__} {error} ({' '.join(where[-4:])})"
        left = {p.as_posix() for p in Path().rglob("*") if p.is_file()}
        left -= {name, "log.csv", "a.mat", "b.mat", "out/samples.parquet", "out/quality.json"}
        fault = fault or (outside and outside[0]) or (left and f"left behind {sorted(left)}")
        pipe.send((end, fault or None))


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
    quality, samples = read_json("out/quality.json"), read_samples("out/samples.parquet")
    t = samples.t.to_numpy()
    if quality["status"] == "rejected":
        sound = not len(t) and quality["reasons"]
    else:
        sound = t[0] == 0 and (np.diff(t) > 0).all() and np.isfinite(samples[SIX]).all(axis=None)
    return quality["status"], None if sound else "the results are not sound"


def judge_config(name):
    """Return whether a config has faults, and what is wrong with their lines."""
    if unreadable(name):
        return "unreadable", None
    config = yaml.safe_load(Path(name).read_text(encoding="utf-8"))
    schema = REPOSITORY / "workflow/schemas/config.schema.yaml"
    found = config_faults(config, {name: name}, schema, {"iphone_6": ["static"]})
    if not found:
        resolve(config)
    return ("faults" if found else "ok"), next((x for x in found if not x.isprintable()), None)
