"""Parts of numpy that scipy names while it is loaded, put off until they are used."""

import sys
from importlib.machinery import PathFinder
from importlib.util import LazyLoader

# a compiler of Fortran and the tools of tests, 0.06 s; scipy takes all of numpy's names
PARTS = ("numpy.f2py", "numpy.testing")


class _Later:
    """A finder of modules that loads the parts when something of them is asked for."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        """Return the spec of a part, leave all else to others."""
        if name not in PARTS:
            return None
        spec = PathFinder.find_spec(name, path)
        spec.loader = LazyLoader(spec.loader)
        return spec


def defer():
    """Let the parts of numpy load when they are used; before scipy is imported."""
    sys.meta_path.insert(0, _Later)
