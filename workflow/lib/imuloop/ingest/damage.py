"""Damaged logs that lack a stream: what was lost is a fault of the data, not of the config."""

from contextlib import contextmanager

from imuloop.core.errors import Lacking, RejectedLog


@contextmanager
def blamed_for_loss(damage):
    """Reject a log that lacks what is looked for in the block, where it is damaged.

    Parameters
    ----------
    damage : list of str
        What a reader found damaged or cut off; a log without damage raises as it does.
    """
    try:
        yield
    except Lacking as error:
        if not damage:
            raise
        raise RejectedLog(f"the log is damaged: {'; '.join(damage)}; {error}") from error
