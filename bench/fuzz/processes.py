"""Cases shared out to processes, each watched by the clock: what crashes or hangs is a fault."""

import multiprocessing
import os
import resource
import sys
import tempfile
import time
from collections import deque
from contextlib import contextmanager
from multiprocessing.connection import wait
from pathlib import Path

import pyarrow as pa

# in memory, where there is such a place
QUICK = Path("/dev/shm")
# bytes that a case may take besides those of the libraries
MEMORY = 1 << 30


@contextmanager
def scratch():
    """Give a folder that is gone afterwards, in memory where there is such a place."""
    place = QUICK if os.access(QUICK, os.W_OK) else None
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=place) as folder:
        yield Path(folder)


def confine(terminal=os.devnull):
    """Send what this process prints to a file; hold it to `MEMORY` more than it has."""
    sys.dont_write_bytecode = True
    with open(terminal, "wb") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    # threads for tables of a few rows cost more than they save
    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def shared_out(numbers, workers, limit, serve, *arguments, batch):
    """Yield number, end and faults of each case; one that ends its process has a fault.

    ``serve(pipe, numbers, *arguments)`` sends end and faults of a case after the other, `batch` of
    them in a process. A case that takes longer than `limit`, s, is stopped.
    """
    context, waiting, running = multiprocessing.get_context("fork"), deque(numbers), {}
    while waiting or running:
        while waiting and len(running) < workers:
            share = deque(waiting.popleft() for _ in range(min(batch, len(waiting))))
            here, there = context.Pipe(duplex=False)
            process = context.Process(target=serve, args=(there, list(share), *arguments))
            process.start()
            there.close()
            running[here] = [process, share, time.monotonic()]
        latest = min(began for *_, began in running.values()) + limit
        done = wait(running, max(0, latest - time.monotonic()))
        for pipe, (process, share, began) in list(running.items()):
            late = time.monotonic() > began + limit
            if pipe in done:
                try:
                    found = pipe.recv()
                except EOFError:
                    process.join()
                    found = "crash", [f"the process ended with {process.exitcode}"]
            elif late:
                found = "hang", [f"not done within {limit} s"]
            else:
                continue
            yield share.popleft(), *found
            running[pipe][2] = time.monotonic()
            if found[0] in ("crash", "hang") or not share:
                process.kill()
                process.join()
                del running[pipe]
                waiting.extendleft(reversed(share))
