"""20,000 mutated maps, records, scenarios, parameter files and launch files (`tools/fuzz_inputs.py`)."""

from __future__ import annotations

import pytest

from tools.fuzz_inputs import KINDS, fuzz


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", KINDS)
def test_mutated_inputs(kind: str, seed: int) -> None:
    counts = fuzz(1000, seed, (kind,))
    assert counts.inputs == 1000
    assert counts.accepted < 1000 or kind in ("parameters", "launch")  # their readers return findings
    assert counts.failures == []
