"""The kinds of records, each with its residuals, noise and diagnosis."""
