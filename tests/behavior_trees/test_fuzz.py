"""Mutated behavior trees: a result or a NavError, nothing else (`tools/fuzz_inputs.py --kind tree` makes more)."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from navstack.core import NavError
from tools.fuzz.trees import VALID, mutated_tree, read_tree


@pytest.mark.slow
def test_mutated_trees_are_read_or_refused(tmp_path: Path) -> None:
    path, accepted = tmp_path / "tree.xml", 0
    for number in range(300):
        path.write_bytes(mutated_tree(random.Random(f"trees/{number}")))
        try:
            read_tree(path)
        except NavError:
            continue
        accepted += 1
    assert 0 < accepted < 300


@pytest.mark.parametrize("number", range(len(VALID)))
def test_the_trees_that_are_mutated_are_valid(tmp_path: Path, number: int) -> None:
    path = tmp_path / "tree.xml"
    path.write_text(VALID[number])
    read_tree(path)
