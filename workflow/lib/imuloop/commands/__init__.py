"""The commands of ``python -m imuloop``: a module each, with `add`, its arguments, and `run`."""
