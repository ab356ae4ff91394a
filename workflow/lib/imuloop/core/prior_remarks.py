"""Remarks on the prior of a calibration: parameters that are its own, and those far from it."""

from imuloop.core.errors import joined

# number of an accelerometer's parameters from which on one advice serves for all of them
MANY = 5
AXES = "xyz"
WORDS = {"T": "misalignment", "K": "scale factor", "b": "bias"}
# likely causes of a parameter far from the data sheet's
CAUSES = {
    "T": "are the axes named and signed as on the sensor?",
    "K": "are its unit and range as declared?",
    "b": "is the offset of its raw unit as declared?",
}


def remarks(sensor, calibration):
    """Return sentences on the prior of one sensor's SensorCalibration, most important first.

    None if all parameters were measured and none is far from the prior.
    """
    found = []
    if far := calibration.far_off:
        listed = joined([f"{_words([name])} ({size:.1f} σ)" for name, size in far.items()])
        causes = " ".join(CAUSES[kind] for kind in dict.fromkeys(name[0] for name in far))
        found.append(f"Far from the data sheet: {listed}; {causes}")
    if calibration.names and calibration.method != "static" and calibration.unimproved:
        found.append(unmeasured(sensor, calibration.unimproved))
    return found


def unmeasured(sensor, names):
    """Return one sentence on parameters that the data did not improve, and what would.

    Takes one or more names, ``T01``, ``K0``, ``b0``.
    """
    theirs = f"{_words(names)} {'are' if len(names) > 1 else 'is'} the data sheet's"
    if sensor == "gyroscope":
        axes = joined(sorted({AXES[int(name[-1])] for name in names}))
        if {name[0] for name in names} == {"b"}:
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


def _words(names):
    """Return parameters in words: misalignment xy and xz, scale factor x, bias x."""
    axes = {
        kind: ["".join(AXES[int(i)] for i in n[1:]) for n in names if n[0] == kind]
        for kind in WORDS
    }
    return joined([f"{word} {joined(axes[kind])}" for kind, word in WORDS.items() if axes[kind]])
