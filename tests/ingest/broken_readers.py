"""A reader that does what the name of its log says."""

import os
import signal
import time
from pathlib import Path

import pyarrow as pa

from imuloop.core.errors import Lacking
from imuloop.core.samples import CHANNELS
from imuloop.ingest.guarded import guarded
from imuloop.ingest.raw_log import RawLog


def end(number):
    os.kill(os.getpid(), number)


def unpack():
    with Path(os.environ["TMPDIR"], "a").open("wb") as file:
        while True:
            file.write(bytes(1 << 20))


def lack():
    raise Lacking("no stream 'a'")


ACTS = {
    "raise": lambda: {}["a\n"],
    "lack": lack,
    "allocate": lambda: bytearray(1 << 30),
    "wait": lambda: time.sleep(100),
    "abort": lambda: end(signal.SIGABRT),
    "kill": lambda: end(signal.SIGKILL),
    "fault": lambda: end(signal.SIGSEGV),
    "unpack": unpack,
    "print": lambda: print("of no concern"),
}


@guarded
def read(paths, columns=None, batch_rows=1 << 16):
    """Give two rows, and do what the log's name says before the first or the second one."""
    act, _, when = paths["log"].stem.partition("_")
    log = RawLog()

    def batches():
        for row in range(2):
            if row:
                log.bad_lines = 7
                ACTS[act]()
            yield pa.record_batch({name: [float(row)] for name in CHANNELS})

    if not when:
        ACTS[act]()
    log.batches = batches()
    return log
