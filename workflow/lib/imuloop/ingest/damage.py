"""Damaged logs that lack a stream: what was lost is a fault of the data, not of the config."""

import re
from contextlib import contextmanager

from imuloop.core.errors import Lacking, RejectedLog


@contextmanager
def blamed_for_loss(damage):
    """Reject a log that lacks what is looked for in the block, where `damage` (texts) was found."""
    try:
        yield
    except Lacking as error:
        if not damage:
            raise
        # the names of streams are enough
        lacks = re.sub(r" \([^()]*\)", "", str(error))
        raise RejectedLog(f"{lacks}; it may be lost to damage: {'; '.join(damage)}") from error
