"""Failures of a stage: written in place of the results of a device, with the reason."""

import errno
import logging
from dataclasses import asdict, dataclass
from pathlib import Path

from imuloop.core.errors import ImuloopError, MachineFault, failure_line
from imuloop.core.files import read_json
from imuloop.core.samples import read_metadata

# what the machine lacks, not the data: room, rights, handles, a disk that reads
MACHINE = (
    *(errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM),
    *(errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EIO, errno.EAGAIN),
)


@dataclass(frozen=True)
class Failure:
    """What went wrong in a stage, in one line, and the log that has the traceback, if any."""

    stage: str
    why: str
    log: str | None

    def __str__(self):
        return f"{self.stage} failed: {self.why}"


def attempt(device, stage, work, write_placeholder, before=()):
    """Run a stage; if it fails, or an earlier one did, write the placeholder of its results.

    ``work()`` writes the stage's results; ``write_placeholder(reason, failed)`` writes some that
    say why there are none, with the content of their key of that name, None where a stage before
    failed, as one of the JSON results `before` may say. Gives the Failures, empty where nothing
    went wrong. What the machine lacks, room, rights or memory, is raised.
    """
    for path in before:
        if earlier := read_json(path).get("failed"):
            write_placeholder(str(Failure(**earlier)), None)
            return []
    try:
        work()
    except (MachineFault, MemoryError):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno in MACHINE:
            raise
        # without a log, what a user can mend is said by its one line alone
        if device.log or not isinstance(error, ImuloopError):
            logging.exception("%s: %s failed", device.name, stage)
        log = device.log and str(device.log)
        failure = Failure(stage, failure_line(error), log)
        write_placeholder(str(failure), asdict(failure))
        return [failure]
    return []


def read_failures(folder, sessions, prior=None):
    """Return the failures of a device's stages, (name of a session or None, Failure), in order.

    Takes the names of its sessions, and the prior that it asks for.
    """
    contents = []
    for name in sessions:
        contents.append((name, read_json(Path(folder, name, "quality.json"))))
        contents.append((name, read_metadata(Path(folder, name, "segments.parquet"))))
    of_prior = ("family_calibration",) if prior else ()
    for name in ("noise", "multi_position", "diagnosis", *of_prior, "exports"):
        if (path := Path(folder, f"{name}.json")).exists():
            contents.append((None, read_json(path)))
    failed = [(name, content.get("failed")) for name, content in contents]
    return [(name, Failure(**each)) for name, each in failed if each]
