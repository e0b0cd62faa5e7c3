"""Write docs/reference/rules.md from the registry of rules.

python tools/rules_page.py
"""

from __future__ import annotations

from pathlib import Path

from navstack.parameters.rules import rules_page

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "rules.md"

if __name__ == "__main__":
    PAGE.write_text(rules_page(), encoding="utf-8")
