"""What to check in an HDF5 file before its library reads it."""

import re
import struct

from imuloop.core.errors import RejectedLog

# begins a heap, in which texts and references lie
_HEAP = b"GCOL\x01\0\0\0"
# read at once, bytes
_PART = 1 << 24
# groups in groups; the libraries go into them by recursion
_DEPTH = 32


def check_hdf5(path):
    """Reject a file that leads its reader elsewhere, or in circles.

    External storage and links, virtual datasets and links of a user's own kind name other files,
    pipes and devices too, which the libraries would open; groups that lie in themselves, and heaps
    without end, they would read for ever. Only hard links are followed here, and no dataset is
    read or asked for its shape.

    Parameters
    ----------
    path : path-like
        An HDF5 file.

    Raises
    ------
    RejectedLog
        If it is such a file.
    """
    check_heaps(path)
    # every run would wait for it
    import h5py
    from h5py import h5d, h5g, h5l, h5o

    def refuse(name, what):
        text = name.decode("utf-8", "replace")[:80]
        raise RejectedLog(f"{what} ({text!r} in the file): refused")

    def address(group, name):
        return h5o.get_info(group, name).addr

    with h5py.File(path, "r") as file:
        groups, soft = [(file.id, 0)], []
        seen = {address(file.id, b".")}
        while groups:
            group, depth = groups.pop()
            for name in group:
                kind = group.links.get_info(name).type
                if kind == h5l.TYPE_SOFT:
                    soft.append((group, name))
                    continue
                if kind != h5l.TYPE_HARD:
                    refuse(name, "a link leads out of the file")
                item = h5o.open(group, name)
                if isinstance(item, h5g.GroupID):
                    if address(group, name) in seen or depth == _DEPTH:
                        refuse(name, "a group lies in itself, in two groups or too deep")
                    seen.add(address(group, name))
                    groups.append((item, depth + 1))
                elif isinstance(item, h5d.DatasetID):
                    made = item.get_create_plist()
                    if made.get_layout() == h5d.VIRTUAL:
                        refuse(name, "a virtual dataset lies in other files")
                    if made.get_external_count():
                        refuse(name, "a dataset is stored in other files")
        # now that no link leads out
        for group, name in soft:
            try:
                leads_to_group = address(group, name) in seen
            except (KeyError, RuntimeError, OSError):
                refuse(name, "a link leads to nothing")
            if leads_to_group:
                refuse(name, "a link leads to a group")


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
