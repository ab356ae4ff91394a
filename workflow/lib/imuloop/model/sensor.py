"""The equation of a sensor with its derivative, for the fit; `calibration` applies it."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Sensor:
    """The equation ``x = T (K (y - b) - e)`` of a sensor, with values of its parameters.

    y are values in nominal SI: raw readings less the data sheet's offset, times its scale. x are
    the calibrated values, on the axes of the body. e is the sum of the sensor's effects: ``e = D
    p``, with their parameters p and the derivative D.

    Attributes
    ----------
    entries : tuple
        Rows and columns of the off-diagonal elements of T that are parameters.
    T : ndarray, shape (3, 3)
        Misalignment, with ones on the diagonal.
    K, b : ndarray, shape (3,)
        Scale factors and biases, nominal SI.
    p : ndarray, shape (q,)
        Parameters of the effects.
    """

    entries: tuple
    T: np.ndarray
    K: np.ndarray
    b: np.ndarray
    p: np.ndarray

    @property
    def gain(self):
        """Derivative of the calibrated x with respect to the nominal y, (3, 3), without effects.

        It is ``T diag(K)``, with the misalignment T and the scale factors K. Its rows are axes of
        the body, its columns axes of the sensor.
        """
        return self.T * self.K

    def output(self, y):
        """Return ``K (y - b)``, SI, on the sensor's own axes, (..., 3), without effects.

        `y`, (..., 3), are values in nominal SI. K are the scale factors and b the biases.
        """
        return self.K * (y - self.b)

    def aligned(self, y):
        """Return ``T K (y - b)``, SI, on the axes of the body, without effects, (..., 3).

        `y`, (..., 3), are values in nominal SI. T is the misalignment, K are the scale factors and
        b the biases.
        """
        return self.output(y) @ self.T.T

    def corrected(self, y, D):
        """Return ``K (y - b) - e``, SI, on the sensor's own axes, (..., 3).

        `y`, (..., 3), are values in nominal SI, K the scale factors, b the biases, and e the sum of
        the effects. `D`, (..., 3, q), is the derivative of e with respect to the q parameters of
        the effects.
        """
        # a search has hundreds of effects of size zero, for which the product is not computed
        return self.output(y) - D @ self.p if self.p.any() else self.output(y)

    def values(self, y, D):
        """Return the calibrated values ``x = T (K (y - b) - e)``, SI, on the body's axes, (..., 3).

        `y`, (..., 3), are values in nominal SI, T is the misalignment, K are the scale factors, b
        the biases, and e is the sum of the effects. `D`, (..., 3, q), is the derivative of e with
        respect to the q parameters of the effects.
        """
        return self.corrected(y, D) @ self.T.T

    def jacobian(self, A, y, D):
        """Return the derivative of sums of ``A x`` with respect to the parameters of the sensor.

        The residuals of a fit are such sums: m of them, each over k samples, and each with `a`
        components. Let c = K (y - b) - e, so that x = T c. The derivative of x_i is c_j with
        respect to T_ij, T_ij (y - b)_j with respect to K_j, and -T_ij K_j with respect to b_j. The
        derivative of x with respect to p is -T D.

        Parameters
        ----------
        A : ndarray, shape (m, k, a, 3)
            Matrix that multiplies the calibrated value x of each sample.
        y : ndarray, shape (m, k, 3)
            Values in nominal SI.
        D : ndarray, shape (m, k, 3, q)
            Derivative of e with respect to the q parameters of the effects.

        Returns
        -------
        ndarray, shape (m, a, number of parameters)
            Derivative with respect to the off-diagonal elements of T, K, b and p, in this order.
        """
        m, k, a, _ = A.shape
        flat = A.reshape(m, k, 3 * a).swapaxes(1, 2)

        def sum_products(values):
            """Return the sums over samples of A_ri v_j, (m, a, 3, 3), for vectors v, (m, k, 3).

            `values` are the v, one for each sample. The axes of the result are: sum, component r of
            A x, axis i of A, axis j of v.
            """
            return (flat @ values).reshape(m, a, 3, 3)

        # the axes are: group m, row r of A, column i of A, axis j of the values
        by_T = sum_products(self.corrected(y, D))[:, :, *self.entries]
        by_K = np.einsum("mrij,ij->mrj", sum_products(y - self.b), self.T)
        by_b = -A.sum(axis=1) @ self.gain
        return np.concatenate([by_T, by_K, by_b, self.effect_jacobian(A, D)], axis=2)

    def effect_jacobian(self, A, D):
        """Return the derivative of sums of ``A x`` by the parameters p of the effects, (m, a, q).

        There are q parameters, and m sums, each over k samples and each with `a` components. `A`,
        (m, k, a, 3), is the matrix that multiplies the calibrated value x of each sample. `D`, (m,
        k, 3, q), is the derivative of the effects' error e with respect to p. As x = T (… - e),
        with the misalignment T, the result is the sum of -A T D.
        """
        m, k, a, _ = A.shape
        # samples and axes become one dimension: one product of matrices instead of one per sample
        AT = np.tensordot(A, self.T, 1).swapaxes(1, 2).reshape(m, a, 3 * k)
        return -AT @ D.reshape(m, 3 * k, D.shape[-1])
