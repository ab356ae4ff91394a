"""Fixtures of the tests of the diagnosis."""

import pytest


@pytest.fixture
def no_limits(monkeypatch):
    """Detection limits take longest, and no verdict hangs on them."""
    monkeypatch.setattr("imuloop.diagnose.content.detection_limits", lambda *a, **k: {"any": 0.0})
