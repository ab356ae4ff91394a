"""HDF5 files that take values from other files of the machine are refused before they are read."""

from imuloop.core.errors import RejectedLog, one_line


def check_hdf5(path):
    """Reject an HDF5 file that has other files opened: they may be any file of the machine.

    NetCDF-4 and MATLAB 7.3 are HDF5. Hard links alone are followed, into each object once. That
    meets all that a soft link can lead to, as such a link is a path of links of the same file.

    Parameters
    ----------
    path : path-like
        A file of any format; one that is no HDF5 passes.

    Raises
    ------
    RejectedLog
        If the file holds external links, external storage or virtual datasets.
    """
    # takes long to import
    import h5py

    if not h5py.is_hdf5(path):
        return

    def links(name, link):
        # all other kinds, those of a user's own too, lead out of the file
        inside = link.type in (h5py.h5l.TYPE_HARD, h5py.h5l.TYPE_SOFT)
        return None if inside else (name.decode(errors="replace"), "an external link")

    def storage(name, item):
        if isinstance(item, h5py.Dataset) and item.external:
            return name, "external storage"
        if isinstance(item, h5py.Dataset) and item.is_virtual:
            return name, "a virtual dataset"
        return None

    with h5py.File(path, "r") as file:
        found = file.id.links.visit(links, info=True) or file.visititems(storage)
    if found:
        name, what = found
        raise RejectedLog(
            f"{one_line(name)} is {what}, whose values lie in another file, which is not read: "
            "save the values themselves in one file"
        )
