"""Blind study: logs of devices as they are, from a generator that shares no code with imuloop."""
