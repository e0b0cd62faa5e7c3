"""docs/parity/nav2.md lists the deliberate differences from Nav2 that the code marks."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "parity" / "nav2.md").read_text("utf-8")
ROWS = [line for line in PAGE.splitlines() if line.startswith("| <a id=")]
NAMED = Counter(file for row in ROWS for file in re.findall(r"`([\w/]+\.py)` \|$", row))
"""File below navstack/ -> rows about it."""


def test_each_comment_in_the_code_has_its_row() -> None:
    marked = {
        file.relative_to(ROOT / "navstack").as_posix(): count
        for file in sorted((ROOT / "navstack").rglob("*.py"))
        if (count := len(re.findall(r"\bNav2 differs:", file.read_text("utf-8"))))
    }
    assert len(marked) >= 8
    assert [f"{file}: {count} comments, {NAMED[file]} rows" for file, count in marked.items() if NAMED[file] < count] == []


def test_each_row_has_an_anchor_of_its_number_and_a_file_that_marks_it() -> None:
    numbers = [re.findall(r'<a id="n(\d+)"></a>(\d+) \|', row) for row in ROWS]
    assert all(len(found) == 1 and found[0][0] == found[0][1] for found in numbers)
    assert len({found[0][0] for found in numbers}) == len(ROWS)
    for file in NAMED:
        assert "Nav2 differs:" in (ROOT / "navstack" / file).read_text("utf-8"), file
