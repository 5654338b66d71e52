"""What every test may use."""

from __future__ import annotations

import numpy as np
import pytest


@pytest.fixture
def record_property(record_property):
    """pytest's own, for NumPy's numbers too: those cannot be sent from one test process to another."""

    def record(name, value):
        record_property(name, value.item() if isinstance(value, np.generic) else value)

    return record
