"""The kinds of records: for each its residuals, its noise and its diagnosis."""
