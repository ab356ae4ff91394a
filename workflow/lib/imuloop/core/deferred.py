"""Parts of numpy that scipy names while it is loaded, put off until they are used."""

import sys
from importlib.util import LazyLoader, find_spec, module_from_spec

import numpy as np

# a compiler of Fortran and the tools of tests, 0.06 s; scipy takes all of numpy's names
PARTS = ("f2py", "testing")


def defer():
    """Let the parts of numpy load when something of them is asked for; before scipy is imported."""
    for part in PARTS:
        name = f"numpy.{part}"
        if name in sys.modules:
            continue
        spec = find_spec(name)
        spec.loader = LazyLoader(spec.loader)
        module = sys.modules[name] = module_from_spec(spec)
        spec.loader.exec_module(module)
        setattr(np, part, module)
