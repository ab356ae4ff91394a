"""HDF5 files that lead their readers elsewhere or in circles, as NetCDF and as MATLAB logs."""

import os
import re
import shutil

import h5py
import netCDF4
import numpy as np
import pytest
from h5py import h5d, h5p, h5s, h5t, h5z

from ingest.test_hostile import in_child

N = 500
OUT, STORED, VIRTUAL = (
    "a link leads out of the file",
    "a dataset is stored in other files",
    "a virtual dataset lies in other files",
)
GROUP, NOTHING = "a group lies in itself, in two groups or too deep", "a link leads to nothing"


def external_link(file, other):
    file["more"] = h5py.ExternalLink(str(other), "/ax")


def link_in_a_group(file, other):
    file.create_group("a/b/c")["more"] = h5py.ExternalLink(str(other), "/ax")


def external_storage(file, other):
    file.create_dataset("more", (1, N), "f8", external=[(str(other), 0, 8 * N)])


def virtual(file, other):
    layout = h5py.VirtualLayout((1, N), "f8")
    layout[:] = h5py.VirtualSource(str(other), "ax", (1, N))
    file.create_virtual_dataset("more", layout)


def virtual_of_any_length(file, other):
    """Whose shape alone makes the library open the other file."""
    more = slice(0, h5s.UNLIMITED)
    layout = h5py.VirtualLayout((N,), "f8", maxshape=(None,))
    layout[more] = h5py.VirtualSource(str(other), "ax", (N,), maxshape=(None,))[more]
    file.create_virtual_dataset("more", layout)


def links_in_a_loop(file, other):
    file["more"], file["most"] = h5py.SoftLink("/most"), h5py.SoftLink("/more")


def link_to_the_group_above(file, other):
    file.create_group("group")["more"] = h5py.SoftLink("/")


def group_in_itself(file, other):
    file.create_group("group")["more"] = file["/"]


def groups_a_thousand_deep(file, other):
    group = file
    for _ in range(1000):
        group = group.create_group("more")


CASES = [
    (external_link, OUT),
    (link_in_a_group, OUT),
    (external_storage, STORED),
    (virtual, VIRTUAL),
    (virtual_of_any_length, VIRTUAL),
    (links_in_a_loop, NOTHING),
    (link_to_the_group_above, "a link leads to a group"),
    (group_in_itself, GROUP),
    (groups_a_thousand_deep, GROUP),
]


@pytest.fixture(params=["log.nc", "log.mat"])
def path(request, log, tmp_path):
    """A sound log to spoil."""
    path = tmp_path / request.param
    with h5py.File(path, "w") as file:
        for name in log.columns:
            values = log[name].to_numpy()
            file[name] = values[None] if path.suffix == ".mat" else values
        if path.suffix == ".nc":
            file["t"].make_scale("t")
            for name in log.columns[1:]:
                file[name].dims[0].attach_scale(file["t"])
    return path


def test_the_log_is_sound(run, log, path):
    np.testing.assert_array_equal(run(path).samples.gx, log.gx)


def told(reason):
    """Return the pattern of the line that a case is refused with."""
    return rf"{reason} \('mo\w+' in the file\): refused"


@pytest.mark.parametrize(("spoil", "reason"), CASES, ids=lambda x: getattr(x, "__name__", ""))
def test_no_other_file_is_read(run, path, spoil, reason):
    shutil.copy(path, path.with_name("other"))
    with h5py.File(path, "r+") as file:
        spoil(file, path.with_name("other"))
    [found] = run(path).quality["reasons"]
    assert re.fullmatch(told(reason), found)


def test_no_pipe_is_waited_for(path):
    """In a process that is ended, should it wait: the library does in C."""
    os.mkfifo(path.with_name("pipe"))
    for number, (spoil, _) in enumerate(CASES):
        shutil.copy(path, path.with_stem(str(number)))
        with h5py.File(path.with_stem(str(number)), "r+") as file:
            spoil(file, path.with_name("pipe"))
    code = f"""
        for number in range({len(CASES)}):
            print(*run(f"{{number}}{path.suffix}")["reasons"])
    """
    found = in_child(path.parent, code).splitlines()
    for line, (_, reason) in zip(found, CASES, strict=True):
        assert re.fullmatch(told(reason), line)


def test_a_link_of_a_users_own_kind(run, path):
    with h5py.File(path, "r+") as file:
        file["more"] = h5py.ExternalLink("AAAA", "/BBBB")
    content = path.read_bytes()
    # version, flags, kind: 64 is external, those above it are the users'
    at = content.rindex(b"\1", 0, content.index(b"\4more"))
    kind = content.index(b"\x40", at)
    path.write_bytes(content[:kind] + b"\x41" + content[kind + 1 :])
    assert run(path).quality["reasons"] == [f"{OUT} ('more' in the file): refused"]


def test_a_filter_that_is_not_known(run, path):
    with h5py.File(path, "r+") as file:
        shape = file["ax"].shape
        del file["ax"]
        made = h5p.create(h5p.DATASET_CREATE)
        made.set_chunk(shape)
        made.set_filter(400, h5z.FLAG_OPTIONAL, (1,))
        space = h5s.create_simple(shape)
        dataset = h5d.create(file.id, b"ax", h5t.NATIVE_DOUBLE, space, made)
        dataset.write_direct_chunk((0,) * len(shape), np.ones(N).tobytes(), 0)
    columns = {"acceleration": ["ax", "ay", "az"], "time": "t"}
    [reason] = run(path, columns=columns).quality["reasons"]
    assert reason.isprintable() and "cannot be read" in reason


def test_the_config_check_does_not_open_them_either(path):
    os.mkfifo(path.with_name("pipe"))
    with h5py.File(path, "r+") as file:
        external_link(file, path.with_name("pipe"))
    code = f"""
        from imuloop.file_faults import file_faults
        session = {{"kind": "static", "file": {path.name!r}}}
        print([*file_faults(session, {{}}, {{}}, True, False)])
    """
    assert in_child(path.parent, code) == "[]\n"


def test_a_link_within_the_file_is_a_second_name(run, log, tmp_path):
    path = tmp_path / "log.nc"
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("t", N)
        for name in log.columns:
            data.createVariable(name.replace("ax", "first"), "f8", ("t",))[:] = log[name].to_numpy()
    with h5py.File(path, "r+") as file:
        file["ax"] = h5py.SoftLink("/first")
    np.testing.assert_array_equal(run(path).samples.ax, log.ax)
