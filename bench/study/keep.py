"""Outcomes as files, written as they come: an interrupted study goes on, its table can be made."""

import os
import pickle


def keep_outcome(folder, name, make, *arguments):
    """Return the outcome of this name in a folder, or else make it now and write it there.

    Without a folder nothing is written.
    """
    path = folder and folder / f"{name}.pickle"
    if path and path.exists():
        return pickle.loads(path.read_bytes())
    outcome = make(*arguments)
    if path:
        folder.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(f".{os.getpid()}")
        part.write_bytes(pickle.dumps(outcome))
        # whole or not at all
        part.replace(path)
    return outcome
