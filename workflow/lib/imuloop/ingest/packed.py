"""How far a packed file may grow when it is unpacked: a small file can hold terabytes of zeros."""

from imuloop.core.errors import RejectedLog

# no log packs better than this
MOST_TIMES = 200


def check_unpacked(packed, unpacked):
    """Refuse a file of `packed` bytes of which so far more than `MOST_TIMES` as many came out."""
    if unpacked > MOST_TIMES * packed:
        raise RejectedLog(
            f"unpacked, the file is more than {MOST_TIMES} times its {packed} bytes: refused, "
            "no log packs so well"
        )
