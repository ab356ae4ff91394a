"""The Python reference, from docstrings: ``make api`` writes build/api.md.

First what `imuloop` itself offers, in full; then every effect; then one line for each function and
class of the library, by module.
"""

import inspect
import pkgutil
from importlib import import_module
from pathlib import Path

import imuloop
from imuloop.calibrate_logs import calibrate
from imuloop.model.effect import Effect
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.plot import Plots

PAGE = Path(__file__).resolve().parents[1] / "build/api.md"
# in full, in the order in which a user meets them
CALLS = (calibrate, imuloop.load, imuloop.read, imuloop.allan)
CLASSES = (
    *(imuloop.Result, imuloop.Calibration, SensorCalibration, Plots),
    *(imuloop.ImuloopError, imuloop.ImuloopWarning),
)


def entry(heading, thing, name):
    """Return a heading, the signature and the docstring."""
    # an exception has no signature
    signed = callable(thing) and not (inspect.isclass(thing) and issubclass(thing, Exception))
    called = f"{name}{inspect.signature(thing)}" if signed else name
    return f"{heading} {name}\n\n```text\n{called}\n\n{inspect.getdoc(thing)}\n```\n"


def methods(of):
    """Return the public methods and properties of a class that have a docstring, by name."""
    named = ((n, inspect.getattr_static(of, n)) for n in vars(of) if not n.startswith("_"))
    attributes = ((n, getattr(of, n) if isinstance(m, classmethod) else m) for n, m in named)
    return {n: m for n, m in attributes if inspect.isroutine(m) or hasattr(m, "__get__")}


def modules():
    """Return each module of the library, by name."""
    walked = pkgutil.walk_packages(imuloop.__path__, "imuloop.")
    return {
        module.name: import_module(module.name)
        for module in walked
        if "__main__" not in module.name
    }


def defined(module):
    """Return the public functions and classes that a module defines, by name."""
    public = ((n, o) for n, o in vars(module).items() if not n.startswith("_"))
    kinds = (inspect.isfunction, inspect.isclass)
    objects = ((n, o) for n, o in public if any(kind(o) for kind in kinds) and o.__name__ == n)
    return {n: o for n, o in objects if o.__module__ == module.__name__}


def first_line(thing):
    """Return the first line of a docstring."""
    return (inspect.getdoc(thing) or "").partition("\n")[0]


def page():
    """Return the reference as Markdown."""
    parts = ["# Python reference of imuloop\n", "## Calls\n"]
    parts += [entry("###", call, call.__name__) for call in CALLS]
    parts.append("## Classes\n")
    for of in CLASSES:
        parts.append(entry("###", of, of.__name__))
        parts += [entry("####", m, f"{of.__name__}.{n}") for n, m in methods(of).items()]
    parts.append("## Effects\n")
    for name, effect in Effect.library.items():
        of = f"{', '.join(effect.sensors)}: {effect.equation}"
        parts.append(f"### {name}\n\n```text\n{of}\n\n{inspect.getdoc(effect)}\n```\n")
    parts.append("## All modules\n")
    for name, module in modules().items():
        lines = [f"- `{n}`: {first_line(o)}" for n, o in defined(module).items()]
        parts.append("\n".join([f"### {name}\n", first_line(module), "", *lines]) + "\n")
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
