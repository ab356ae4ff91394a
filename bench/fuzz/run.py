"""Cases shared out to workers, each watched by the clock."""

import os
import tempfile
import time
from collections import Counter
from multiprocessing.connection import wait
from pathlib import Path

from bench.fuzz import worker as limits
from bench.fuzz.cases import case
from bench.fuzz.seeds import all_seeds
from bench.fuzz.worker import Worker

# in memory, where there is such a place
QUICK = Path("/dev/shm")


def fuzz(cases, seconds=float("inf"), first=0, only=None, keep=None, workers=2):
    """Run cases in workers; return how they ended, and the faulty ones.

    Parameters
    ----------
    cases, first : int
        How many, from which number on; other numbers are other cases.
    seconds : float
        No case begins after so long.
    only : str, optional
        Kind of log; all if None.
    keep : Path, optional
        Folder for the files of faulty cases.
    workers : int
        Processes at once.

    Returns
    -------
    ends : Counter
        (kind, end) to number of cases.
    faults : list of (int, str, str)
        Number, kind and what happened.
    """
    ends, faults = Counter(), []
    place = QUICK if os.access(QUICK, os.W_OK) else None
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=place) as folder:
        seeds = {k: each for k, each in all_seeds(Path(folder)).items() if only in (None, k)}
        free = [Path(folder) / f"worker_{i}" for i in range(workers)]
        running, stop = {}, time.monotonic() + seconds
        numbers = iter(range(first, first + cases))
        idle = []
        while True:
            while (free or idle) and time.monotonic() < stop:
                if (number := next(numbers, None)) is None:
                    break
                worker = idle.pop() if idle else Worker(free.pop(), seeds)
                worker.start(number)
                running[worker.pipe] = worker
            if not running:
                break
            soonest = min(worker.began for worker in running.values()) + limits.SECONDS
            done = wait(running, max(0, soonest - time.monotonic()))
            late = time.monotonic() - limits.SECONDS
            for pipe, worker in list(running.items()):
                if pipe not in done and worker.began > late:
                    continue
                del running[pipe]
                kind, end, fault = worker.end(pipe in done)
                ends[kind, end] += 1
                if fault:
                    faults.append((worker.number, kind, fault))
                if worker.process.is_alive():
                    idle.append(worker)
                else:
                    free.append(worker.folder)
        for worker in idle:
            worker.stop()
        if keep:
            keep.mkdir(parents=True, exist_ok=True)
            for number, _, _ in faults:
                _, name, content, _ = case(number, seeds)
                (keep / f"{number}_{name}").write_bytes(content)
    return ends, sorted(faults)
