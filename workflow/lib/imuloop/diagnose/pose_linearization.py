"""The rows of the poses linearised at a fit, and the alternatives of their noise."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from imuloop.estimate.evidence import Evidence, Hypotheses
from imuloop.estimate.held_out import held_out_covariance
from imuloop.estimate.noise_components import SizeLikelihood, likely_sizes, total_covariance

# alternatives of the noise: steps from the sizes as estimated to the likeliest sizes
PATH = np.array([0.0, 0.3, 0.6, 1.0])


@dataclass(frozen=True)
class Linearization:
    """The N rows of a PoseProblem, linearised at the fit of all poses with some effects.

    A row is one component of a residual of a pose, a move between poses, or a prior.
    """

    solution: object  # the Fit, with p parameters
    factors: object  # Linearised factors at its parameters
    values: np.ndarray  # (N,): residuals
    jacobian: np.ndarray  # (N, p): derivative with respect to the parameters
    evidence: Evidence  # Evidence of the rows
    likelihood: SizeLikelihood  # likelihood of the sizes of the k variance components of the noise
    likeliest: np.ndarray  # (k,): the most likely sizes

    @property
    def slow(self):
        """Variance components of slow noise, a list of Component.

        The noise model gives their sizes and the errors of these sizes. Each kind of residual also
        has an excess, noise that the noise model lacks. It is a component, too, but is not in the
        list, since the noise model says nothing about its size.
        """
        return [c for c in self.likelihood.components if np.isfinite(c.deviation)]

    @property
    def variance(self):
        """Variance of each of the N rows (scalar residuals) by the noise as estimated, (N,).

        The sizes of slow noise are those in the noise model. The excess of each kind of residual,
        noise that the noise model lacks, is left out.
        """
        slow = (np.diag(c.covariance) * c.size**2 for c in self.slow)
        return np.diag(self.likelihood.fixed) + sum(slow)

    @cached_property
    def alternatives(self):
        """The m alternatives of the noise for the verdict, as two parts: priors and covariances.

        An alternative is one covariance that the noise may have. The first part, (m,), has the
        logarithm of the prior probability of each alternative. The second part is a list of the m
        covariances of the rows (scalar residuals), (N, N) each. The alternatives differ in the
        sizes of slow noise. The first alternative has the sizes as estimated, the last one has the
        likeliest sizes, and alternative j has gone the share `PATH[j]` of the way between them. The
        whole way has the length d, in standard deviations of the estimated sizes, so that the
        logarithm of the prior probability is ``-(d PATH[j])²/2``.
        """
        fixed, slow = self.likelihood.fixed, self.slow
        sizes = np.array([component.size for component in slow])
        change = likely_sizes(self.values, self.jacobian, fixed, slow) - sizes
        distance = change / [component.deviation for component in slow]
        covariances = [total_covariance(fixed, slow, sizes + share * change) for share in PATH]
        return -(distance @ distance) * PATH**2 / 2, covariances

    @cached_property
    def error_covariances(self):
        """Covariances of the held-out errors of N rows, a list of m arrays, (N, N).

        There is one for each of the m alternatives, covariances that the noise may have. Each fold
        is predicted by a fit to the rows outside it.
        """
        return self.error_covariances_by(self.alternatives[1])

    def error_covariances_by(self, covariances):
        """Return the covariance of the held-out errors for each covariance of the rows, a list.

        `covariances` has the covariances of the N rows (scalar residuals), (N, N) each; the
        covariances of the errors have the same shape. Each fold is predicted by a fit, with the
        effects, to the rows outside it.
        """
        folds = self.evidence.row_folds
        return [held_out_covariance(noise, self.jacobian, folds) for noise in covariances]


def kind_hypotheses(components, likelihood, likeliest):
    """Return noise hypotheses in which the noise of one kind of residual may be larger alone.

    A hypothesis is one covariance that the noise may have. Here it follows from one size for each
    variance component, noise whose size is estimated. Each component belongs to one kind of
    residual. There are four sorts of hypotheses. Components have their likeliest sizes

    - for no kind of residual: the first hypothesis;
    - for one kind: a hypothesis per kind;
    - for all kinds but one: a hypothesis per kind;
    - for all kinds: the last hypothesis.

    All other components have their sizes as estimated.

    Parameters
    ----------
    components : list of Component
        The k variance components of the noise.
    likelihood : SizeLikelihood
        Likelihood of the sizes of the components.
    likeliest : ndarray, shape (k,)
        The most likely sizes.

    Returns
    -------
    Hypotheses
        h hypotheses.
    ndarray, shape (h,) of bool
        Whether all sizes of each hypothesis are as estimated.
    """
    kinds, number = np.unique([c.kind for c in components], return_inverse=True)
    # which kinds have the likeliest sizes: none, one, all but one, all
    single = np.eye(len(kinds), dtype=bool)
    none = np.zeros_like(single)
    is_likeliest = np.unique(np.vstack([none, single, ~single, ~none]), axis=0)[:, number]
    sizes = np.where(is_likeliest, likeliest, likelihood.prior_sizes)
    return Hypotheses.of(map(likelihood.covariance, sizes**2)), ~is_likeliest.any(axis=1)
