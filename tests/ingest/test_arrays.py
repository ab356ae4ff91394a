"""Links of HDF5 that would have other files of the machine read."""

import os
import re

import h5py
import pytest

from imuloop.core.errors import RejectedLog
from imuloop.ingest.reference import read_series

WAYS = {
    "external storage": lambda group, name, other: group.create_dataset(
        name, (9,), "f8", external=[(str(other), 0, 72)]),
    "an external link": lambda group, name, other: group.__setitem__(
        name, h5py.ExternalLink(str(other), "/ax")),
    "a virtual dataset": lambda group, name, other: group.create_virtual_dataset(
        name, h5py.VirtualLayout((9,), "f8")),
}  # fmt: skip


def hdf5(path, log, way=None, other="AAAA", group="/"):
    """Write a log, and one way out of the file; MATLAB puts its own 512 bytes in front of HDF5."""
    matlab = path.suffix == ".mat"
    with h5py.File(path, "w", userblock_size=512 * matlab) as file:
        for name in log.columns:
            file[name] = log[name].to_numpy()[None] if matlab else log[name].to_numpy()
            if not matlab:
                file["t"].make_scale("t") if name == "t" else file[name].dims[0].attach_scale(
                    file["t"]
                )
        if way:
            WAYS[way](file.require_group(group), "more", other)
            # circles, in which the walk over all links ends
            file["around"], file["and_around"] = h5py.SoftLink("/and_around"), h5py.SoftLink("/ar")
            file["itself"] = file["/"]
        elif not matlab:
            # a second name within the file does not lead out
            file.move("ax", "first")
            file["ax"] = h5py.SoftLink("/first")
    if matlab:
        with open(path, "r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ["log.nc", "log.mat"])
def test_no_other_file_is_opened(log, run, same, tmp_path, name, way):
    """Protects the files of a machine that reads an unknown log: a pipe would be waited for.

    A log that holds a reference is the second way in.
    """
    hdf5(tmp_path / name, log)
    same(run(tmp_path / name), log)
    os.mkfifo(tmp_path / "pipe")
    hdf5(tmp_path / name, log, way, tmp_path / "pipe", "group/deeper")
    done = run(tmp_path / name)
    line = "the values of .*group/deeper/more lie in another file, which is not read"
    assert re.match(line, done.quality["reasons"][0]) and len(done.samples) == 0
    if name == "log.mat":
        with pytest.raises(RejectedLog, match=line):
            read_series(tmp_path / name, None, {"time": "t", "orientation": ["gx"]})


def test_a_link_of_a_users_own_kind_leads_out(log, refused, tmp_path):
    """Protects against kinds of links that are not known here: 64 is external, above are others."""
    hdf5(path := tmp_path / "log.nc", log, "an external link", group="g")
    data = path.read_bytes()
    # version, flags, kind
    kind = data.index(b"\x40", data.rindex(b"\1", 0, data.index(b"\4more")))
    path.write_bytes(data[:kind] + b"\x41" + data[kind + 1 :])
    refused("the values of g/more lie in another file", path, error=False)
