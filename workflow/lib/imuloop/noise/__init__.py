"""From the rests of sessions to noise coefficients.

Read the modules in this order:

1. `records`: clean stretches of the sessions; `signal`: the values of a channel in the stretches of
   one power cycle.
2. `modes`: amplitudes of a record in a basis where noise hardly correlates, and their expected
   squares; `processes`: the covariance of each noise process.
3. `likelihood`: the likelihood of the amplitudes, and its maximum for given noise terms;
   `selection`: the terms that a record supports; `intervals`: coefficients with intervals.
4. `gains`, `low_pass`: a filter in front of the output; `misfit`: smaller weights for frequencies
   at which no model fits.
5. `periodogram`, `sinusoids`, `lines`: how lines are found, fitted and named.
6. `axis` estimates the noise of one axis by steps 2 to 5, and `noise` the noise of a device.

`allan` and `spectrum` compute the curves of the pictures.
"""
