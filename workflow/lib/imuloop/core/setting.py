"""A setting of a stage: its default, its meaning with the unit, and its limits in one place.

A check of the config reads these fields with pydantic. A stage does not load pydantic.
"""

from dataclasses import field


def setting(default, description, **limits):
    """Return a setting: a field of a dataclass with its default, description and limits.

    `default` is the default value, and `description` a text with the unit. `limits` are bounds:
    ``gt`` and ``lt``, exclusive, or ``ge`` and ``le``, inclusive, of a number; ``min_length`` and
    ``max_length`` of a list.
    """
    # without `strict`, pydantic would take a text such as 1e-3 for a number
    exact = {"strict": True} if isinstance(default, (int, float)) else {}
    return field(default=default, metadata={"description": description, **exact, **limits})
