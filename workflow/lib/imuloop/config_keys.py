"""General types of the values in a config, and the mapping of keys that reports all faults."""

from typing import Annotated, Union

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationError,
    model_validator,
)

from imuloop.core.errors import nearest

Text = Annotated[str, Field(min_length=1)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, strict=True, allow_inf_nan=False)]
# a value may have one of several types; each is a branch in pydantic's errors, whose name begins
# with these words, as no key does
BRANCH = "branch of the type: "
# words for the Python types of values, in the order in which they are tried
_WORDS = {"text": str, "truth": bool, "number": (int, float), "list": list, "mapping": dict}


def kind_of(value):
    """Return the word for the Python type of a value.

    The words are text, truth, number, list, mapping, and null for None or another type.
    """
    return next((word for word, kind in _WORDS.items() if isinstance(value, kind)), "null")


def either(by=kind_of, **types):
    """Return the pydantic type of a value that may have one of several types.

    `types` are these types by their names. `by` is a function that takes a value and returns the
    name of the type that it has to fit.
    """
    members = tuple(Annotated[member, Tag(BRANCH + name)] for name, member in types.items())
    # members is a tuple, which | does not take
    return Annotated[Union[members], Discriminator(lambda value: BRANCH + by(value))]  # noqa: UP007


def is_branch(part):
    """Return whether a `part` of the path in an error of pydantic names a branch, not a key.

    A branch is one of the types that a value may have, as `either` declares them.
    """
    return part == "[key]" or str(part).startswith(BRANCH)


class Keys(BaseModel):
    """A mapping in a config that refuses unknown keys, and reports all of its faults at once."""

    model_config = ConfigDict(extra="forbid")

    @classmethod
    def faults(cls, keys, context):
        """Yield (path, text) for each fault that depends on several keys; here none.

        Parameters
        ----------
        keys : dict
            The keys as written; a value that has a fault itself is None.
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
        """Return the model of a mapping; raise a ValidationError with all faults of its keys.

        Without this method, faults that depend on several keys would not be reported together with
        the faults of each key by itself. `data` is the mapping as written, `validate` the
        validation of pydantic, and `info` its state.
        """
        model, errors, faults = None, [], []
        try:
            model = validate(data)
        except ValidationError as error:
            errors = error.errors(include_url=False)
        if isinstance(data, dict):
            unknown = [key for key in data if key not in cls.model_fields]
            faults = [((key,), f"unknown key{nearest(key, cls.model_fields)}") for key in unknown]
            errors = [error for error in errors if error["loc"][0] not in unknown]
            wrong = {error["loc"][0] for error in errors} & {*data}
            faults += cls.faults(data | dict.fromkeys(wrong), info.context)
        for path, text in faults:
            context = {"error": ValueError(text)}
            errors.append({"type": "value_error", "loc": path, "input": data, "ctx": context})
        if errors:
            raise ValidationError.from_exception_data(cls.__name__, errors)
        return model
