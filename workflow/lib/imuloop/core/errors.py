"""Errors that a user can act on."""


class ImuloopError(Exception):
    """What the user declared or gave cannot be used; one line, no traceback needed."""


class RejectedLog(ImuloopError):
    """What is wrong lies in the data: the session is rejected, the run goes on."""
