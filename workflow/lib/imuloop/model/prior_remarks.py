"""Remarks on the prior of a calibration.

They name the parameters that the data did not improve, and those that are far from the prior.
"""

from imuloop.core.errors import joined

# number of unimproved parameters of an accelerometer from which on they get one common advice
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
    """Return remarks for the user on a calibrated sensor and its prior, a list of sentences.

    They name the parameters that are improbably far from the prior, and then those that the data
    hardly improved. The list is empty if there are none. `sensor` is the name of the sensor, and
    `calibration` its SensorCalibration.
    """
    sentences = []
    if far := calibration.far_off:
        listed = joined([f"{_words([name])} ({size:.1f} σ)" for name, size in far.items()])
        causes = " ".join(CAUSES[letter] for letter in dict.fromkeys(name[0] for name in far))
        sentences.append(f"Far from the data sheet: {listed}; {causes}")
    # a gyroscope that only rested has its reason already
    if calibration.names and calibration.method != "static" and calibration.unimproved:
        sentences.append(advice_on_unimproved(sensor, calibration.unimproved))
    return sentences


def advice_on_unimproved(sensor, names):
    """Return a text that names parameters that the data did not improve, and says what to record.

    `sensor` is the name of the sensor. `names` are one or more parameters, such as ``T01``, ``K0``
    and ``b0``.
    """
    subject = f"{_words(names)} {'are' if len(names) > 1 else 'is'} the data sheet's"
    if sensor == "gyroscope":
        axes = joined(sorted({AXES[int(name[-1])] for name in names}))
        if {name[0] for name in names} == {"b"}:
            return f"No rest was recorded: {subject}. Leave the device at rest for a minute."
        return (
            f"Too few turns about {axes}: {subject}. Turn the device by 90° or more about {axes} "
            "from one rest to the next, both ways."
        )
    if len(names) >= MANY:
        return (
            f"Too few poses: {subject}. Add poses until each axis was up, down and halfway between "
            "each other axis: twelve or more in all."
        )
    # a misalignment needs poses between two axes, a scale factor or a bias the axis up and down
    between = [f"{AXES[int(n[1])]} and {AXES[int(n[2])]}" for n in names if n[0] == "T"]
    upright = sorted({AXES[int(n[1])] for n in names if n[0] != "T"})
    causes = []
    if between:
        causes.append(f"No pose lies between {joined(between)}")
    if upright:
        causes.append(f"No two poses have {joined(upright)} up and down")
    return f"{'; '.join(causes)}: {subject}. Add two poses there."


def _words(names):
    """Return parameters in words, such as "misalignment xy and xz, scale factor x and bias x".

    `names` are names of parameters, such as ``T01``, ``K0`` and ``b0``.
    """
    # by word, the axes of its parameters, in the order of the words
    axes = {}
    for name in sorted(names, key=lambda name: [*WORDS].index(name[0])):
        axes.setdefault(WORDS[name[0]], []).append("".join(AXES[int(i)] for i in name[1:]))
    return joined([f"{word} {joined(of_word)}" for word, of_word in axes.items()])
