"""Diagnosis: the effects that a model lacks, from the residuals of each kind of record."""
