"""From a known truth to a raw log."""
