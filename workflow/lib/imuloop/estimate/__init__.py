"""The estimator of every kind of record: fit, noise, tests, cross-validation, limits, verdict.

Terms of this package:

row
    One scalar residual, of a pose, of a move, or of the mean over a window at rest.
effect, kind, variant
    An effect is an error that the base model lacks. Its kind is the type of error and the sensor.
    A variant is an effect with values of its constants, such as a time constant. The parameters of
    a variant are linear, and a fit estimates them.
base
    The effects that are in the model already when another effect is tested.
base model
    The model of a sensor without effects: bias, scale factors and misalignments.
pattern
    The derivative of all rows with respect to the parameters of one variant.
column
    One column of a pattern on one axis, scaled to length one and stored under a number.
nuisance parameters
    The parameters that every fit estimates: the level of each record, or the base model.
hypothesis
    One covariance that the noise of the rows may have. Tests average over all hypotheses.
evidence
    All rows with their hypotheses, and the columns of all patterns.
fold
    The rows that cross-validation holds out together. Folds have numbers; -1 is no fold.
training rows, training fit
    The rows that are not held out, and the least-squares fit to them.
held-out error, floor
    The error of a prediction of held-out rows. The floor is the error that the noise alone gives.
trial
    The significance test of one effect, in its best variant, added to the base.
"""
