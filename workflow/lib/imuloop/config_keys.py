"""Types of values in a config that may be of several kinds, and mappings that report all faults."""

from contextlib import suppress
from copy import deepcopy
from typing import Annotated, Union

from pydantic import BaseModel, ConfigDict, Discriminator, Tag, ValidationError, model_validator

# a value may have one of several types; each is a branch in pydantic's errors, whose name begins
# with these words, as no key does
BRANCH = "branch of the type: "


def kind_of(value):
    """Return the name of the branch for a value, by its Python type."""
    kinds = {"string": str, "bool": bool, "float": (int, float), "list": list, "keys": dict}
    return BRANCH + next((kind for kind, of in kinds.items() if isinstance(value, of)), "null")


def either(by=kind_of, **types):
    """Return the type of a value that may have one of several `types`, given by name.

    `by` is a function that returns the name of the branch, the type that a value has to fit.
    """
    members = tuple(Annotated[each, Tag(BRANCH + kind)] for kind, each in types.items())

    def branch(value):
        """Return the name of the branch for a value; whole numbers count as int if there is one."""
        kind = by(value)
        return f"{BRANCH}int" if kind == f"{BRANCH}float" and "int" in types else kind

    # members is a tuple, which | does not take
    return Annotated[Union[members], Discriminator(branch)]  # noqa: UP007


def is_branch(part):
    """Return whether a part of the path in an error of pydantic is no key of the config.

    Then it names a branch: an alternative of a value that may have several types.
    """
    return part == "[key]" or str(part).startswith(BRANCH)


def _without_values(data, paths):
    """Return nested data, copied, in which the values at `paths` are None."""
    if paths:
        data = deepcopy(data)
    for path in paths:
        node, keys = data, [part for part in path if not is_branch(part)]
        # a missing key has no value
        with suppress(LookupError, TypeError):
            for key in keys[:-1]:
                node = node[key]
            if node[keys[-1]] is not None:
                node[keys[-1]] = None
    return data


def holds_none(value):
    """Return whether a value in nested mappings is None."""
    return value is None or (isinstance(value, dict) and any(map(holds_none, value.values())))


class Keys(BaseModel):
    """A mapping of keys, which has no unknown keys."""

    model_config = ConfigDict(extra="forbid")

    @classmethod
    def faults(cls, keys, context):
        """Yield (path, text) for each fault that depends on several keys.

        Parameters
        ----------
        keys : dict
            The keys as written; each value that has a fault itself, at any depth, is None.
        context : dict or None
            ``{"replicas": …}`` if the files that are named have to exist, else None.

        Yields
        ------
        path : tuple of str or int
            Keys that lead from this mapping to the fault.
        text : str
            The fault.
        """
        yield from ()

    @model_validator(mode="wrap")
    @classmethod
    def _add_faults(cls, data, validate, info):
        """Validate each key by itself, then what depends on several keys; raise all faults."""
        model, errors = None, []
        try:
            model = validate(data)
        except ValidationError as error:
            errors = error.errors(include_url=False)
        if isinstance(data, dict):
            keys = _without_values(data, [error["loc"] for error in errors])
            for path, text in cls.faults(keys, info.context):
                context = {"error": ValueError(text)}
                errors.append({"type": "value_error", "loc": path, "input": data, "ctx": context})
        if errors:
            raise ValidationError.from_exception_data(cls.__name__, errors)
        return model
