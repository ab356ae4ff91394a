"""HDF5 files that would have other files of the machine read."""

import os

import h5py
import numpy as np
import pytest

from imuloop.core.errors import RejectedLog
from imuloop.core.samples import CHANNELS
from imuloop.ingest.reference import read_series

N, SECRET = 500, b"root:x:0:secret!"


@pytest.fixture(params=["log.nc", "log.mat"])
def sound(request, log, tmp_path):
    """Return a sound log to spoil; MATLAB puts its own 512 bytes in front of HDF5."""
    path = tmp_path / request.param
    matlab = path.suffix == ".mat"
    with h5py.File(path, "w", userblock_size=512 * matlab) as file:
        for name in log.columns:
            file[name] = log[name].to_numpy()[None] if matlab else log[name].to_numpy()
        if not matlab:
            file["t"].make_scale("t")
            for name in CHANNELS:
                file[name].dims[0].attach_scale(file["t"])
    if matlab:
        with open(path, "r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")
    return path


def external_storage(group, name, other, shape):
    group.create_dataset(name, shape, "f8", external=[(str(other), 0, 8 * N)])


def external_link(group, name, other, shape):
    group[name] = h5py.ExternalLink(str(other), "/ax")


def virtual(group, name, other, shape):
    layout = h5py.VirtualLayout(shape, "f8")
    layout[:] = h5py.VirtualSource(str(other), "ax", shape)
    group.create_virtual_dataset(name, layout)


def virtual_of_any_length(group, name, other, shape):
    """How long it is, the other file says."""
    longest = (*shape[:-1], None)
    layout = h5py.VirtualLayout(shape, "f8", maxshape=longest)
    more = (*(slice(n) for n in shape[:-1]), slice(0, h5py.h5s.UNLIMITED))
    layout[more] = h5py.VirtualSource(str(other), "ax", shape, maxshape=longest)[more]
    group.create_virtual_dataset(name, layout)


WAYS = {
    external_storage: "external storage",
    external_link: "an external link",
    virtual: "a virtual dataset",
    virtual_of_any_length: "a virtual dataset",
}


@pytest.fixture
def secret(tmp_path):
    """Return two files of the machine: any bytes, and an HDF5 file of the same as numbers."""
    raw, other = tmp_path / "passwd", tmp_path / "other.h5"
    raw.write_bytes(SECRET * (N // 2))
    with h5py.File(other, "w") as file:
        file["ax"] = np.frombuffer(raw.read_bytes())
    return {way: raw if way is external_storage else other for way in WAYS}


def spoil(path, way, other, name="ax", group="/"):
    with h5py.File(path, "r+") as file:
        shape = file["ax"].shape
        place = file.require_group(group)
        place.pop(name, None)
        way(place, name, other, shape)


def refusal(name, way):
    return (
        f"{name} is {WAYS[way]}, whose values lie in another file, which is not read: save the "
        "values themselves in one file"
    )


def test_the_log_that_is_spoilt_below_is_sound(run, log, sound):
    np.testing.assert_array_equal(run(sound).samples.gx, log.gx)


@pytest.mark.parametrize("way", WAYS)
def test_no_byte_of_another_file_is_read(run, sound, secret, way):
    """Protects all files of a machine that reads a log of somebody else.

    It is refused whether or not the log's variable is used, and no part of it gets into a result;
    nor is it read as attitudes beside a log, in MATLAB files, the second way in.
    """
    spoil(sound, way, secret[way])
    done = run(sound)
    assert done.quality["reasons"] == [refusal("ax", way)]
    assert len(done.samples) == 0
    for file in done.path.parent.iterdir():
        assert SECRET[:8] not in file.read_bytes()
    if sound.suffix == ".mat":
        with pytest.raises(RejectedLog, match=WAYS[way]):
            read_series(sound, None, {"time": "t", "orientation": ["gx"]})


# the walk is the same in both formats
@pytest.mark.parametrize(
    "sound", ["log.nc", pytest.param("log.mat", marks=pytest.mark.study)], indirect=True
)
@pytest.mark.parametrize("way", WAYS)
def test_a_pipe_is_found_behind_other_links_and_not_waited_for(run, sound, tmp_path, way):
    """Protects against opening what is named: the refusal comes before the library opens it.

    And the walk over the links, by which it is found: circles end, a soft link hides nothing.
    """
    os.mkfifo(tmp_path / "pipe")
    spoil(sound, way, tmp_path / "pipe", "more", "group/deeper")
    with h5py.File(sound, "r+") as file:
        del file["ax"]
        file["ax"] = h5py.SoftLink("/group/deeper/more")
        file["around"], file["and_around"] = h5py.SoftLink("/and_around"), h5py.SoftLink("/around")
        file["group/itself"], file["group/above"] = file["group"], file["/"]
    [reason] = run(sound).quality["reasons"]
    assert reason.endswith(refusal("deeper/more", way))


def test_a_link_of_a_users_own_kind_is_external(run, sound):
    """Protects against kinds of links that are not known here: 64 is external, above are others."""
    spoil(sound, external_link, "AAAA", "more")
    content = sound.read_bytes()
    # version, flags, kind
    kind = content.index(b"\x40", content.rindex(b"\1", 0, content.index(b"\4more")))
    sound.write_bytes(content[:kind] + b"\x41" + content[kind + 1 :])
    assert run(sound).quality["reasons"] == [refusal("more", external_link)]


@pytest.mark.parametrize("sound", ["log.nc"], indirect=True)
def test_a_second_name_within_the_file_is_read(run, log, sound):
    """Protects files that are whole: a soft link is no way out."""
    with h5py.File(sound, "r+") as file:
        file.move("ax", "first")
        file["ax"] = h5py.SoftLink("/first")
    np.testing.assert_array_equal(run(sound).samples.ax, log.ax)
