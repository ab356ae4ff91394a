"""pyarrow without pandas, for jobs that have no need of it."""

import sys


class _Hidden:
    """A finder of modules to which there is no pandas."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        """Refuse pandas, leave all else to others."""
        if name == "pandas":
            raise ImportError(name)


def hide_pandas():
    """Let pyarrow find no pandas, unless it is loaded already.

    At the first array that it converts pyarrow loads pandas, for 0.3 s, only to ask whether the
    array is one of its own. It asks once. ``to_pandas``, ``Table.from_pandas`` and ``import
    pandas`` load it all the same; until then pyarrow takes a Series for any sequence, so this is
    for the processes of jobs, not for those of a user.
    """
    if "pyarrow" not in sys.modules or "pandas" in sys.modules:
        return
    import pyarrow

    sys.meta_path.insert(0, _Hidden)
    try:
        pyarrow.array([0])
    finally:
        sys.meta_path.remove(_Hidden)
