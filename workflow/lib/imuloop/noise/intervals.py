"""Coefficients with intervals, and limits of those that are not supported."""

from dataclasses import dataclass
from functools import cache
from itertools import compress

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import ndtr, ndtri

from imuloop.core.noise_model import AxisNoise, Coefficient, GaussMarkov
from imuloop.noise.processes import NAMES
from imuloop.noise.terms import replaced

# terms that may stand in for each other: intervals are averaged over models with and without them,
# but for models of less weight than this share
FREE, NEGLIGIBLE = ("B", "K", "R"), 1e-3


def axis_noise(search, terms):
    r"""Return the AxisNoise of supported terms: values with intervals, limits of the others.

    Values are those of the supported terms alone, so that together they are the spectrum that
    was found. An interval has to allow for terms that are too weak to pass and for one that
    stands where another is true: it ends where the tail areas of all models m with or without
    flicker, walk and ramp,

    .. math:: \sum_m w_m \Phi\left(\pm\sqrt{2 (\ell_m - \ell_m(x))}\right),
        \quad w_m \propto e^{\ell_m - k_m},

    reach 2.5 %. :math:`\ell_m(x)` is the profile likelihood of the coefficient, and weights of
    models of k terms are Akaike's.

    Parameters
    ----------
    search : Search
        Of one axis.
    terms : Terms
        The supported ones.

    Returns
    -------
    AxisNoise

    References
    ----------
    D. Fletcher and D. Turek, J. Agric. Biol. Environ. Stat. 17 (2012) 38.
    """
    fit = search.fit(terms, True)
    values = dict(zip(terms.names, np.sqrt(fit.theta), strict=False))
    if terms.ramp:
        values["R"] = abs(fit.ramp)
    coefficients = {}
    for name in (*NAMES, "R"):
        profiles = [_profile(search, name, model) for model in _models(search, terms, name)]
        if name in values:
            coefficients[name] = _coefficient(profiles, values[name])
        else:
            # a ramp has either sign, so that the limit of the likelier one is a two-sided one
            coefficients[name] = _limit(profiles, 2 if name == "R" else 1)
    wide = terms.plus("N").plus("B").plus("K")
    top = search.fit(wide, True)
    processes = tuple(_process(search, wide, top, i) for i in range(len(terms.times)))
    return AxisNoise(**coefficients, gauss_markov=processes)


def _models(search, terms, name):
    """Return the models that hold a term: with and without each of those that may stand in.

    One in which such a term comes out as zero is the model without it.
    """
    free = [t for t in FREE if t in search.candidates and t != name]
    base = terms.plus("N").plus(name)
    for t in free:
        base = base.without(t)
    models = [base]
    for t in free:
        models += [model.plus(t) for model in models]
    return [m for m in models if all(_there(search, t, m) for t in free if t in m.names)]


def _there(search, name, model):
    return search.fit(model).theta[model.names.index(name)] > 0


def _profile(search, name, model):
    """Return the profile likelihood of a coefficient in a model."""
    rest = model.without(name)
    units = search.units(rest)
    if name == "R":
        likeliest = search.fit(model)
        sign, best = np.copysign(1.0, likeliest.ramp), abs(likeliest.ramp)

        def value(x):
            return search.likelihood.fit(units, sign * x, start=likeliest.theta).value

    else:
        unit = search.modes.units[:, NAMES.index(name)]
        likeliest = search.fit(model, True)
        place = model.names.index(name)
        best, start = np.sqrt(likeliest.theta[place]), np.delete(likeliest.theta, place)

        def value(x):
            return search.likelihood.fit(units, rest.ramp, x**2 * unit, start, True).value

        # where another term takes its place: small beside what is there
        best = max(best, 1e-3 * np.sqrt(np.min(search.units(model) @ likeliest.theta / unit)))
    weight = search.fit(model).value - len(model)
    return _Profile(weight, best, likeliest.value, value)


def _process(search, terms, fit, place):
    """Return a Gauss-Markov process, q and tc profiled over each other."""
    tc, rest = terms.times[place], terms.without(terms.times[place])
    q = np.sqrt(2 * fit.theta[len(terms.names) + place] / tc)
    units = search.units(rest)

    def value(q, tc):
        fixed = q**2 * tc / 2 * search.modes.gauss_markov(tc)
        return search.likelihood.fit(units, rest.ramp, fixed, restricted=True).value

    def of_q(x):
        around = np.log(tc) + np.array([-3.0, 3.0])
        found = minimize_scalar(lambda u: -value(x, np.exp(u)), bounds=around, method="bounded")
        return max(-found.fun, value(x, tc))

    def of_tc(x):
        return search.fit(replaced(terms, place, x), True).value

    return GaussMarkov(
        *(_coefficient([_Profile(0.0, x, fit.value, of)], x) for x, of in ((q, of_q), (tc, of_tc)))
    )


@dataclass(frozen=True)
class _Profile:
    """Profile likelihood of a coefficient in one model: `value` at x, at most `top` at `best`."""

    weight: float
    best: float
    top: float
    value: object

    def below(self, x):
        """Return the tail area below x."""
        root = np.sqrt(2 * max(self.top - self.value(x), 0.0))
        return ndtr(np.copysign(root, x - self.best))


def _averaged(profiles):
    """Return the tail area below x, averaged over models, and the heaviest model's best value."""
    weight = np.exp(np.array([p.weight for p in profiles]) - max(p.weight for p in profiles))
    used = weight > NEGLIGIBLE * weight.sum()
    weight, profiles = weight[used], list(compress(profiles, used))
    weight /= weight.sum()

    @cache
    def below(x):
        return sum(w * p.below(x) for w, p in zip(weight, profiles, strict=True))

    return below, profiles[int(weight.argmax())].best


def _coefficient(profiles, value):
    """Return a supported coefficient."""
    value = float(value)
    below, best = _averaged(profiles)
    low, high, upper = (_crossing(below, value or best, p) for p in (0.025, 0.975, 0.95))
    return Coefficient(value, (min(low, value), max(high, value)), max(upper, value), True)


def _limit(profiles, sides):
    """Return the upper limit of a coefficient that is not supported."""
    below, best = _averaged(profiles)
    return Coefficient(None, None, _crossing(below, best, 1 - 0.05 / sides), False)


def _crossing(below, near, area):
    """Return where a tail area that grows reaches a value, 0 where it is larger everywhere."""

    def excess(u):
        # as normal deviates, in which a tail area is nearly straight
        return ndtri(np.clip(below(float(np.exp(u))), 1e-12, 1 - 1e-12)) - ndtri(area)

    near, step = np.log(near), 0.02
    side = -1 if excess(near) > 0 else 1
    while step < 80:
        far = near + side * step
        if excess(far) * side > 0:
            return float(np.exp(brentq(excess, near, far, xtol=1e-5)))
        near, step = far, 3 * step
    return 0.0
