"""Harmed stretches of recordings, from the raw log to the report: is every result sound?"""
