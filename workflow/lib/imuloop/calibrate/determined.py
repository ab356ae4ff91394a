"""The fewest poses and rotations that determine a sensor, and whether a fit is valid."""

import numpy as np

from imuloop.calibrate.accelerometer import NAMES as OF_ACCELEROMETER
from imuloop.calibrate.accelerometer import AccelerometerModel
from imuloop.calibrate.least_squares import condition_number, too_large
from imuloop.core.errors import plural

# the axes of an accelerometer, cheap ones and three glued to a cube too, are less off square, rad
SLANT = 0.3
# what data sheets of MEMS sensors allow: misalignment, rad; scale factor, 1
AXES, SCALE = 0.02, 0.03
# an accelerometer's nine parameters and a check; rotations for the nine of T and K, two rows each
LEAST_POSES, LEAST_ROTATIONS = len(OF_ACCELEROMETER) + 1, 5
NO_POSE = "no multi_position session with a pose"
# of a gyroscope; why the accelerometer is not is said of the accelerometer
NO_DIRECTION = "direction of gravity not known: the accelerometer is not calibrated"


def accelerometer_undetermined(poses, gravity, largest):
    """Return why Poses do not determine the nine parameters, or None if they do.

    Takes gravity, m/s^2, and the largest condition number of the design.
    """
    n = len(poses)
    if not n:
        return NO_POSE
    if n < LEAST_POSES:
        found = f"{plural(n, 'pose')} found, at least {LEAST_POSES} needed"
        return f"{found} for 9 parameters and a check"
    model = AccelerometerModel(poses.f, np.zeros((n, 3, 0)), gravity)
    x = model.start()
    condition = _accelerometer_condition(model.residuals(x)[1], x, gravity)
    if condition <= largest:
        return None
    return (
        f"the attitudes of {n} poses do not determine 9 parameters: "
        f"{too_large(condition, largest)}; add poses in between each axis up and down"
    )


def _accelerometer_condition(jacobian, x, gravity):
    """Return the condition number of the nine parameters at x, each by its natural size."""
    K = np.abs(x[3:6])
    return condition_number(jacobian, np.concatenate([np.ones(3), K, gravity / K]))


def accelerometer_invalid(jacobian, white, covariance, x, gravity, largest):
    """Return why a fit of gravity's norm is invalid, or None if it is valid.

    Gravity's norm is also met where K tends to zero and K b to a vector as long as gravity. What
    lies on no ellipsoid is drawn there, and there the poses determine nothing; or to axes that no
    accelerometer has. Takes the derivative of the norms, (n, 9), their errors, each given those
    before it, (n,), and the parameters, (9,), with their covariance.
    """
    condition, slant = _accelerometer_condition(jacobian, x, gravity), np.max(np.abs(x[:3]))
    if not condition <= largest:
        leads = f"where they determine nothing, {too_large(condition, largest)}"
    elif slant > SLANT or np.min(x[3:6]) <= 0:
        leads = f"axes {slant:.2g} rad from square, at most {SLANT:g} is plausible"
    elif beyond := known_worse(scaled(covariance, white), x[3:6]):
        return (
            f"{len(jacobian)} poses show {beyond}: they are too much alike, or contradict each "
            "other; add poses in between each axis up and down"
        )
    else:
        return None
    return no_ellipsoid(len(jacobian), leads)


def no_ellipsoid(poses, leads):
    """Return why poses that no accelerometer gives have no fit, text.

    Takes the number of poses, and where the fit leads, text.
    """
    return (
        f"specific force at {poses} poses lies on no ellipsoid of an accelerometer: the fit leads "
        f"to {leads}; was a pose clipped or wrapped around, did scale or offset change midway?"
    )


def gyroscope_undetermined(jacobian, largest):
    """Return why rotations do not determine T and K, or None if they do.

    Takes the derivative of the errors of the rotations with respect to T, K and b, (m, 2, 12), and
    the largest condition number of the design.
    """
    count = len(jacobian)
    if count < LEAST_ROTATIONS:
        return (
            f"{plural(count, 'rotation')} between poses found, at least {LEAST_ROTATIONS} "
            "needed for the 9 parameters of misalignment and scale factor"
        )
    condition = condition_number(jacobian.reshape(-1, 12)[:, :9], np.ones(9))
    if condition <= largest:
        return None
    return (
        f"the axes of {count} rotations do not determine misalignment and scale "
        f"factor: {too_large(condition, largest)}; turn about each axis, both ways, "
        "by 90 degrees and more"
    )


def gyroscope_invalid(jacobian, white, covariance, K, largest):
    """Return why a fit of rotations is invalid, or None if it is valid.

    It is where the rotations do not determine T and K at the solution, or contradict each other.
    Takes the derivative of the errors of m rotations with respect to T and K, (2 m, 9), these
    errors, each given those before it, (2 m,), the covariance of T and K, and K, (3,).
    """
    sizes, count = np.append(np.ones(6), np.abs(K)), len(jacobian) // 2
    condition = condition_number(jacobian, sizes)
    if condition > largest:
        return (
            f"no misalignment and scale factor carries gravity through {count} rotations: the "
            f"fit leads to where they determine nothing, {too_large(condition, largest)}; was the "
            "angular rate clipped or wrapped around, did scale or axes change midway?"
        )
    if beyond := known_worse(scaled(covariance, white), K):
        return (
            f"{count} rotations show {beyond}: they are too few, or contradict each other; was the "
            "angular rate clipped?"
        )
    return None


def scaled(covariance, white):
    """Return a covariance, larger where the errors of its fit, (n,), contradict each other."""
    return covariance * max(1.0, white @ white / max(len(white) - 9, 1))


def known_worse(covariance, K):
    """Return what a data sheet knows as well, text, or None; the covariance is of T, then K."""
    std, of_axes = np.sqrt(np.diag(covariance)), len(covariance) - 3
    return beyond_data_sheet(std[:of_axes].max(), np.max(std[of_axes:] / np.abs(K)))


def beyond_data_sheet(axes, scale):
    """Return what a data sheet knows as well, text, or None where data know it better.

    Takes the largest standard errors of the misalignment, rad, and of the scale factor, over it.
    """
    if axes <= AXES and scale <= SCALE:
        return None
    return (
        f"misalignment to {axes:.2g} rad and scale factor to {100 * scale:.2g} %, a data sheet to "
        f"{AXES:g} rad and {100 * SCALE:g} %"
    )
