"""Kinds of records: what each shows of a device."""
