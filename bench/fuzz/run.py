"""Cases shared out to workers, each watched by the clock."""

import os
import tempfile
import time
from collections import Counter
from contextlib import contextmanager
from multiprocessing.connection import wait
from pathlib import Path

from bench.fuzz import worker as limits
from bench.fuzz.cases import case
from bench.fuzz.seeds import all_seeds
from bench.fuzz.worker import Worker, serve

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
    with scratch() as folder:
        seeds = {k: each for k, each in all_seeds(folder).items() if only in (None, k)}
        numbers = range(first, first + cases)
        done = shared_out(numbers, workers, folder, limits.SECONDS, serve, seeds, seconds=seconds)
        for number, kind, end, fault in done:
            ends[kind, end] += 1
            if fault:
                faults.append((number, kind, fault))
        if keep:
            keep.mkdir(parents=True, exist_ok=True)
            for number, _, _ in faults:
                _, name, content, _ = case(number, seeds)
                (keep / f"{number}_{name}").write_bytes(content)
    return ends, sorted(faults)


@contextmanager
def scratch():
    """Give a folder that is gone afterwards, in memory where there is such a place."""
    place = QUICK if os.access(QUICK, os.W_OK) else None
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=place) as folder:
        yield Path(folder)


def shared_out(
    numbers, workers, folder, limit, serve, *arguments, seconds=float("inf"), once=False
):
    """Give cases to workers; yield number, kind, end and fault of each that is done.

    Parameters
    ----------
    numbers : iterable of int
        The cases.
    workers : int
        Processes at once.
    folder : Path
        For theirs.
    limit : float
        A case that takes longer is stopped, s.
    serve : callable
        See `Worker`.
    *arguments
        Of `serve`.
    seconds : float
        No case begins after so long.
    once : bool
        Whether each case has a process of its own.
    """
    free = [folder / f"worker_{i}" for i in range(workers)]
    running, idle, stop = {}, [], time.monotonic() + seconds
    numbers = iter(numbers)
    while True:
        while (free or idle) and time.monotonic() < stop:
            if (number := next(numbers, None)) is None:
                break
            worker = idle.pop() if idle else Worker(free.pop(), serve, *arguments)
            worker.start(number)
            running[worker.pipe] = worker
        if not running:
            break
        soonest = min(worker.began for worker in running.values()) + limit
        done = wait(running, max(0, soonest - time.monotonic()))
        late = time.monotonic() - limit
        for pipe, worker in list(running.items()):
            if pipe not in done and worker.began > late:
                continue
            del running[pipe]
            yield worker.number, *worker.end(pipe in done, limit)
            if once:
                worker.stop()
            if worker.process.is_alive():
                idle.append(worker)
            else:
                free.append(worker.folder)
    for worker in idle:
        worker.stop()
