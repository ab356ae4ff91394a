"""Cases made and handed to a worker, one after the other."""

import shutil
import tempfile
import time
from collections import Counter
from pathlib import Path

from bench.fuzz.cases import case
from bench.fuzz.seeds import ROWS, all_seeds
from bench.fuzz.worker import Worker


def fuzz(cases, seconds=float("inf"), first=0, only=None, keep=None):
    """Run cases in a worker; return how they ended, and the faulty ones.

    Parameters
    ----------
    cases, first : int
        How many, from which number on.
    seconds : float
        No case begins after so long.
    only : str, optional
        Kind of log; all if None.
    keep : Path, optional
        Folder for the files of faulty cases.

    Returns
    -------
    ends : Counter
        (kind, end) to number of cases.
    faults : list of (int, str, str)
        Number, kind and what happened.
    """
    ends, faults, worker = Counter(), [], None
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        seeds = all_seeds(Path(folder))
        four = b"0 0 0 9.8\n" * ROWS
        beside = {"log.csv": seeds["csv"][0][1], "a.mat": four, "b.mat": four}
        seeds = {kind: each for kind, each in seeds.items() if only in (None, kind)}
        begin = time.monotonic()
        for number in range(first, first + cases):
            if time.monotonic() - begin > seconds:
                break
            work = Path(folder) / "work"
            shutil.rmtree(work, ignore_errors=True)
            work.mkdir()
            worker = worker or Worker(work)
            kind, name, content, declared = case(number, seeds)
            for other, text in beside.items() if kind == "config" else ():
                (work / other).write_bytes(text)
            (work / name).write_bytes(content)
            end, fault = worker.run(name, declared)
            ends[kind, end] += 1
            if fault:
                faults.append((number, kind, fault))
                if keep:
                    keep.mkdir(parents=True, exist_ok=True)
                    (keep / f"{number}_{name}").write_bytes(content)
            if not worker.lives():
                worker = None
        if worker:
            worker.stop()
    return ends, faults
