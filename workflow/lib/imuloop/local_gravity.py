"""Local gravity by latitude and height."""

import numpy as np


def normal_gravity(latitude, height):
    """Return normal gravity on and above the WGS 84 ellipsoid, m/s^2.

    On the ellipsoid it is ``g0 = ge (1 + k sin²φ) / sqrt(1 - e² sin²φ)`` (Somigliana), and above it
    ``g = g0 [1 - 2 (1 + f + m - 2 f sin²φ) h/a + 3 h²/a²]``. φ is the geodetic `latitude`, degrees,
    and h the `height` above the ellipsoid, m. All other symbols are constants of WGS 84: ge is
    gravity at the equator, k the constant of Somigliana's formula, e² the squared eccentricity, a
    the semi-major axis in metres, f the flattening, and m the ratio of the centrifugal acceleration
    to gravity at the equator.

    References
    ----------
    NIMA TR8350.2, 3rd edition, section 4, equations 4-1 and 4-3.
    """
    s2 = np.sin(np.radians(latitude)) ** 2
    a, f, m = 6378137.0, 1 / 298.257223563, 0.00344978650684
    surface = 9.7803253359 * (1 + 0.00193185265241 * s2) / np.sqrt(1 - f * (2 - f) * s2)
    return float(surface * (1 - 2 * (1 + f + m - 2 * f * s2) * height / a + 3 * (height / a) ** 2))
