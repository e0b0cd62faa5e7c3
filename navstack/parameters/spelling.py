"""Find the known name that a misspelt one stands for."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z0-9]+")
MIN_WORD = 3
"""Shorter words are abbreviations: x for y."""
_SEPARATORS = re.compile(r"[_\-. ]")


def nearest(name: str, known: Iterable[str], cutoff: float = 0.75) -> str | None:
    """Return the known name closest to a misspelt one, None if none is similar enough (`cutoff`, 0 .. 1)."""
    names = sorted(set(known))
    by_lower = {n.lower(): n for n in names}
    if name.lower() in by_lower:
        return by_lower[name.lower()]
    # the same words in another order or without underscores: vel_max_x, maxvelx
    squeezed = {_SEPARATORS.sub("", n.lower()): n for n in names}
    if _SEPARATORS.sub("", name.lower()) in squeezed:
        return squeezed[_SEPARATORS.sub("", name.lower())]
    words = sorted(name.lower().split("_"))
    for n in names:
        if len(words) > 1 and sorted(n.lower().split("_")) == words:
            return n
    close = difflib.get_close_matches(name.lower(), list(by_lower), n=3, cutoff=cutoff)
    return next((by_lower[c] for c in close if _is_near(name, by_lower[c])), None)


def _is_near(name: str, known: str) -> bool:
    """False if a whole word differs: NeoLocalPlanner is another planner than PalLocalPlanner, not a misspelt one."""
    words, others = ([w.lower() for w in _WORDS.findall(text)] for text in (name, known))
    if len(words) != len(others):
        return True
    return all(len(w) < MIN_WORD or difflib.SequenceMatcher(None, w, o).ratio() > 0.0 for w, o in zip(words, others))
