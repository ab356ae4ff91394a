"""The library of effects: all modules of the package are loaded, and their effects register.

The docstring of an effect begins with the equation of e, the error that the effect adds to the
output of a sensor on axis i. *Leaves* is the trace in the residuals of a calibration without the
effect. *Imitated by* are other effects that leave a similar trace.
"""

from importlib import import_module
from pkgutil import iter_modules

from imuloop.model.effect import Effect

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")
# the order of the effects in results
Effect.library = dict(sorted(Effect.library.items()))
