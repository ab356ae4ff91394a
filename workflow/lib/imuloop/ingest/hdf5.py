"""What to check in an HDF5 file before its library reads it."""

import re
import struct

from imuloop.core.errors import RejectedLog

# begins a heap, in which texts and references lie
_HEAP = b"GCOL\x01\0\0\0"
# read at once, bytes
_PART = 1 << 24


def check_heaps(path):
    """Reject a file with a heap that the library would read for ever.

    From object to object it goes by their sizes, and stays where one of them is nothing.

    Parameters
    ----------
    path : path-like
        An HDF5 file.

    Raises
    ------
    RejectedLog
        If there is such a heap.
    """
    with open(path, "rb") as file:
        heaps, base, text = [], 0, b""
        while part := file.read(_PART):
            # a mark may lie across two parts
            base, text = base + max(0, len(text) - len(_HEAP) + 1), text[1 - len(_HEAP) :] + part
            heaps += [base + match.start() for match in re.finditer(re.escape(_HEAP), text)]
        # no object takes less than 8 bytes, and none is in two heaps
        left = file.tell() // 8
        for begin in heaps:
            file.seek(begin + len(_HEAP))
            end = begin + int.from_bytes(file.read(8), "little")
            at = begin + 16
            while at + 16 <= end and (head := _read_at(file, at, 16)):
                number, size = struct.unpack("<H6xQ", head)
                # number 0 is what is free; the library counts modulo 2^64
                step = (size if number == 0 else 16 + size + -size % 8) % (1 << 64)
                at, left = at + step, left - 1
                if not step or left < 0:
                    raise RejectedLog("the file is damaged: a heap of it has no end")


def _read_at(file, at, size):
    """Return so many bytes, or none behind the end of the file."""
    if at >= 1 << 62:
        return b""
    file.seek(at)
    found = file.read(size)
    return found if len(found) == size else b""
