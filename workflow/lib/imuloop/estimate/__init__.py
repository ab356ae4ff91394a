"""The fit of all factors and the prior, with the size of the noise."""
