"""The library of effects: all modules of the package are loaded, and their effects register."""

from importlib import import_module
from pkgutil import iter_modules

from imuloop.model.effect import Effect

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")
# the order of the effects in results
Effect.library = dict(sorted(Effect.library.items()))
