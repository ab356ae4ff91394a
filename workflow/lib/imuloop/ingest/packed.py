"""How far a packed file may grow when it is unpacked: a small file can hold terabytes of zeros."""

from imuloop.core.errors import RejectedLog

# no log packs better than this
MOST_TIMES = 200
# most that is held in memory at once, bytes
MOST_HELD = 4 << 30


def check_unpacked(packed, unpacked, held=False):
    """Refuse a file that grows too much.

    Parameters
    ----------
    packed, unpacked : int
        Size of the file and of what came out of it so far, bytes.
    held : bool
        Whether what comes out is held in memory.

    Raises
    ------
    RejectedLog
        If it is more than `MOST_TIMES` times the file, or `MOST_HELD` if it is held.
    """
    if unpacked > MOST_TIMES * packed:
        raise RejectedLog(
            f"unpacked, the file is more than {MOST_TIMES} times its {packed} bytes: refused, "
            "no log packs so well"
        )
    if held and unpacked > MOST_HELD:
        raise RejectedLog(f"unpacked, the file is more than {MOST_HELD >> 30} GB: refused")
