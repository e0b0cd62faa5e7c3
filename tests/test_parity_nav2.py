"""docs/parity/nav2.md lists the deliberate differences from Nav2 that the code marks."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "parity" / "nav2.md").read_text("utf-8")
ROWS = [line for line in PAGE.splitlines() if line.startswith("| <a id=")]
NAMED = Counter(file for row in ROWS for file in re.findall(r"`([\w/]+\.py)` \|$", row))
"""End of a file's path -> rows about it."""


def rows_of(file: str) -> int:
    return sum(count for named, count in NAMED.items() if f"/{file}".endswith(f"/{named}"))


def test_each_comment_in_the_code_has_its_row() -> None:
    marked = {
        file.relative_to(ROOT / "navstack").as_posix(): count
        for file in sorted((ROOT / "navstack").rglob("*.py"))
        if (count := len(re.findall(r"\bNav2 differs:", file.read_text("utf-8"))))
    }
    assert len(marked) >= 8
    missing = [
        f"{file}: {count} comments, {rows_of(file)} rows" for file, count in marked.items() if rows_of(file) < count
    ]
    assert missing == []


def test_each_row_has_an_anchor_of_its_number_and_a_file_that_marks_it() -> None:
    numbers = [re.findall(r'<a id="n(\d+)"></a>(\d+) \|', row) for row in ROWS]
    assert all(len(found) == 1 and found[0][0] == found[0][1] for found in numbers)
    assert len({found[0][0] for found in numbers}) == len(ROWS)
    for named in NAMED:
        files = [f for f in (ROOT / "navstack").rglob(Path(named).name) if f.as_posix().endswith(f"/{named}")]
        assert any("Nav2 differs:" in file.read_text("utf-8") for file in files), named
