"""The rows of poses, linearised at a fit, and the noise that they may have."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from imuloop.estimate.evidence import Evidence, Hypotheses
from imuloop.estimate.noise_components import SizeLikelihood


@dataclass(frozen=True)
class Linearization:
    """The N rows of a PoseProblem, linearised at the fit of all poses with some effects.

    A row is one component of a residual of a pose, a move between poses, or a prior.
    """

    solution: object  # the Fit, with p parameters
    factors: object  # Linearised factors at its parameters
    values: np.ndarray  # (N,): residuals
    jacobian: np.ndarray  # (N, p): derivative with respect to the parameters
    # alternatives of the noise, from the sizes as estimated to the likeliest sizes: logarithm of
    # the prior probability, (m,), and covariance, (N, N) each
    log_prior: np.ndarray
    covariances: list
    evidence: Evidence  # Evidence of the rows
    likelihood: SizeLikelihood  # likelihood of the sizes of the k variance components of the noise
    likeliest: np.ndarray  # (k,): the most likely sizes


def kind_hypotheses(components, likelihood, likeliest):
    """Return noise hypotheses, covariances of the noise, that treat each kind of residual alone.

    Under each hypothesis, the components of one kind of residual have the likeliest sizes and all
    others the sizes as estimated, or the reverse. The first hypothesis has all sizes as estimated,
    and the last one has all likeliest sizes.

    Parameters
    ----------
    components : list of Component
        The k variance components of the noise.
    likelihood : SizeLikelihood
        Likelihood of their sizes.
    likeliest : ndarray, shape (k,)
        The most likely sizes.

    Returns
    -------
    Hypotheses
        h hypotheses.
    ndarray, shape (h,) of bool
        Which of them have all sizes as estimated.
    """
    kinds, number = np.unique([c.kind for c in components], return_inverse=True)
    # which kinds have the likeliest sizes: none, one, all but one, all
    single = np.eye(len(kinds), dtype=bool)
    none = np.zeros_like(single)
    is_likeliest = np.unique(np.vstack([none, single, ~single, ~none]), axis=0)[:, number]
    sizes = np.where(is_likeliest, likeliest, likelihood.prior_sizes)
    return Hypotheses.of(map(likelihood.covariance, sizes**2)), ~is_likeliest.any(axis=1)


def split_by_effect(values, effects):
    """Return a dict that has for each effect its part of the last axis of `values`.

    The last axis, (q,), has the parameters of all effects, one effect after the other.
    """
    ends = pairwise(np.cumsum([0, *(len(e.parameters) for e in effects)]))
    return {e: values[..., i:j] for e, (i, j) in zip(effects, ends, strict=True)}
