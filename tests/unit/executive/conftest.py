"""The planner that the tasks of all tests share; it remembers nothing."""

from __future__ import annotations

import pytest

from debrisgrasp.pipeline import Pipeline


@pytest.fixture(scope="session")
def pipeline():
    return Pipeline()
