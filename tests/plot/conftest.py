from __future__ import annotations

import pytest

from navstack.record import Record
from tests.record import synthetic


@pytest.fixture(scope="session")
def record() -> Record:
    return synthetic.record_run(24.0).record()
