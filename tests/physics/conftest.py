"""Prepared objects of known shape, made here so that no other stage has to run."""

from __future__ import annotations

import pytest

from pipeline.records.objects import PreparedObject
from tests.physics.shapes import prepared_box


@pytest.fixture(scope="session")
def cube() -> PreparedObject:
    return prepared_box((0.042, 0.042, 0.042))
