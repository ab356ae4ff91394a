"""Tables of the report, made of result files."""
