"""Which parameters of a calibration the data did not determine, and which poses or turns would."""

from imuloop.core.errors import joined

# number of an accelerometer's parameters from which on one advice serves for all of them
MANY = 5
AXES = "xyz"


def advice(sensor, names):
    """Return one sentence on the parameters that are the data sheet's, and what would measure them.

    Parameters
    ----------
    sensor : str
        accelerometer or gyroscope.
    names : sequence of str
        Names of the parameters that the data did not improve, ``T01``, ``K0``, ``b0``.

    Returns
    -------
    str
        Empty if all of them were measured.
    """
    if not names:
        return ""
    theirs = f"{joined(map(_words, names))} {'are' if len(names) > 1 else 'is'} the data sheet's"
    if sensor == "gyroscope":
        axes = joined(sorted({AXES[int(name[-1])] for name in names}))
        found = "the gyroscope's bias" if {n[0] for n in names} == {"b"} else None
        if found:
            return f"No rest was recorded: {theirs}. Leave the device at rest for a minute."
        return (
            f"Too few turns about {axes}: {theirs}. Turn the device by 90° or more about {axes} "
            "from one rest to the next, both ways."
        )
    if len(names) >= MANY:
        return (
            f"Too few poses: {theirs}. Add poses until each axis was up, down and halfway between "
            "each other axis: twelve or more in all."
        )
    sentences = []
    between = [f"{AXES[int(n[1])]} and {AXES[int(n[2])]}" for n in names if n[0] == "T"]
    upright = sorted({AXES[int(n[1])] for n in names if n[0] != "T"})
    if between:
        sentences.append(f"No pose lies between {joined(between)}")
    if upright:
        sentences.append(f"No two poses have {joined(upright)} up and down")
    return f"{'; '.join(sentences)}: {theirs}. Add two poses there."


def _words(name):
    """Return a parameter in words: misalignment xy, scale factor x, bias x."""
    kind = {"T": "misalignment", "K": "scale factor", "b": "bias"}[name[0]]
    return f"{kind} {''.join(AXES[int(i)] for i in name[1:])}"
