"""From rests to noise coefficients.

Read the modules in this order:

1. `records`: clean stretches of the sessions; `signal`: their samples in each power cycle.
2. `modes`: amplitudes of a record in a basis in which noise is nearly uncorrelated, and their
   expected squares; `processes`: the covariance of each noise process.
3. `likelihood`: the likelihood of the modes, and its maximum for given terms; `selection`: the
   terms that a record supports; `intervals`: coefficients with intervals.
4. `gains`, `low_pass`: a filter in front of the output; `misfit`: smaller weights of frequencies
   at which no model fits.
5. `periodogram`, `sinusoids`, `lines`: search, fit and names of lines.
6. `axis` estimates the noise of one axis by steps 2 to 5, and `noise` the noise of a device.

`allan` and `spectrum` compute the curves of the pictures.
"""
