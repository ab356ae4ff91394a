"""The tables in a zip: read as they inflate, none unpacked to disk, what is unsafe refused."""

import csv
import zipfile
from pathlib import PureWindowsPath

from imuloop.core.errors import RejectedLog
from imuloop.ingest.packed import check_unpacked

# read of a small table
_SMALL = 1 << 16


class DamagedZip(RejectedLog):
    """A zip or a file in it that cannot be inflated."""


class Member:
    """A file in a zip as it inflates; one that is damaged is a rejected log."""

    closed = False

    def __init__(self, archive, info):
        self._name = f"{info.filename[:80]!r} in the zip is damaged"
        self._stream = checked(self._name, archive.open, info)

    def read(self, size=-1):
        """Return up to `size` bytes."""
        return checked(self._name, self._stream.read, size)

    def readable(self):
        """Return True."""
        return True

    def writable(self):
        """Return False."""
        return False

    def seekable(self):
        """Return False: going back would inflate all again."""
        return False

    def close(self):
        """Close."""
        self._stream.close()
        self.closed = True


def checked(what, call, *arguments):
    """Return what zipfile's call gives; its dozen kinds of errors become one."""
    try:
        return call(*arguments)
    except Exception as error:
        why = (str(error) or type(error).__name__).splitlines()[0]
        raise DamagedZip(f"{what}: {why}") from error


def find_members(archive, packed):
    """Return name without folder and ending -> ZipInfo of the CSV files, all safe to read."""
    infos = archive.infolist()
    for info in infos:
        place = PureWindowsPath(info.filename)
        # splits at / as well
        if place.anchor or ".." in place.parts:
            raise RejectedLog(f"the zip holds a file outside of it: {info.filename[:80]!r}")
        if place.suffix.lower() == ".zip":
            raise RejectedLog(f"the zip holds a zip, {info.filename[:80]!r}: give that one instead")
    members, inflated = {}, 0
    for info in infos:
        if not info.filename.lower().endswith(".csv") or info.filename.startswith("__MACOSX/"):
            continue
        name = f"{info.filename[:80]!r} in the zip"
        if info.flag_bits & 1:
            raise RejectedLog(f"{name} is encrypted")
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise RejectedLog(f"{name} is packed by method {info.compress_type}, not by deflate")
        inflated += info.file_size
        check_unpacked(info.compress_size, info.file_size)
        check_unpacked(packed, inflated, held=True)
        place = PureWindowsPath(info.filename)
        key = "meta/" * (place.parent.name == "meta") + place.stem
        if key in members:
            raise RejectedLog(f"the zip holds two files {place.name[:80]!r}: give one recording")
        members[key] = info
    return members


def small_table(archive, info):
    """Return the cells of a small table."""
    text = Member(archive, info).read(_SMALL).decode("utf-8-sig", "replace")
    head = text.partition("\n")[0]
    return [*csv.reader(text.splitlines(), delimiter=max(",;\t", key=head.count))]
