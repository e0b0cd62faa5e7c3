"""Find the known name that a misspelt one stands for."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z0-9]+")
MIN_WORD = 3
"""Shorter words are abbreviations: x for y."""
_MOST_EDITS = 8
"""A name with so many wrong letters is another name."""
MOST_TYPOS = 2
_SEPARATORS = re.compile(r"[_\-. ]")
_OPPOSITES: tuple[tuple[frozenset[str], ...], ...] = tuple(
    tuple(frozenset(words.split()) for words in group)
    for group in (
        ("min minimum low lower", "max maximum high upper"),
        ("x vx", "y vy", "th theta vth vtheta rot rotational yaw angular angle", "trans translational linear xy"),
        ("global", "local"),
        ("path", "goal", "obstacle"),
        ("marking", "clearing"),
        ("front", "rear", "left", "right"),
        ("width", "height"),
    )
)
"""Words that exclude each other: a name with one of a group is not a misspelt name with another one."""


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


def is_certain(name: str, found: str, known: Iterable[str]) -> bool:
    """Return True if the known name `found` is clearly nearer to a misspelt one than all others in `known`.

    Nearer: by one edit (a letter more, less, exchanged or swapped with its neighbor), by half as many again from two edits on.
    """
    edits = _edits(name, found, _MOST_EDITS)
    limit = edits + max(1, (edits + 1) // 2) - 1
    return edits < _MOST_EDITS and all(_edits(name, other, limit + 1) > limit for other in set(known) - {found})


def is_typo(name: str, known: str) -> bool:
    """Return True for at most MOST_TYPOS wrong letters (a letter more, less, exchanged or swapped with its neighbor)."""
    return _edits(name, known, MOST_TYPOS + 1) <= MOST_TYPOS


def _edits(name: str, known: str, limit: int) -> int:
    """Number of edits between two names, at most `limit`; 0 for the same words with other separators, case or order."""
    one, other = name.lower(), known.lower()
    if _SEPARATORS.sub("", one) == _SEPARATORS.sub("", other) or sorted(one.split("_")) == sorted(other.split("_")):
        return 0
    if abs(len(one) - len(other)) >= limit:
        return limit
    # optimal string alignment, row by row
    before: list[int] = []
    row = list(range(len(other) + 1))
    for i, letter in enumerate(one):
        earlier, before, row = before, row, [i + 1]
        for j, wanted in enumerate(other):
            cost = min(before[j] + (letter != wanted), before[j + 1] + 1, row[j] + 1)
            if i and j and letter == other[j - 1] and one[i - 1] == wanted:
                cost = min(cost, earlier[j - 1] + 1)
            row.append(cost)
        if min(row) >= limit:
            return limit
    return min(row[-1], limit)


def _is_near(name: str, known: str) -> bool:
    """False if a whole word differs: NeoLocalPlanner is another planner than PalLocalPlanner, not a misspelt one.

    Nor is max_speed a misspelt min_speed, or vy_samples a misspelt vx_samples.
    """
    words, others = ([w.lower() for w in _WORDS.findall(text)] for text in (name, known))
    for group in _OPPOSITES:
        one, other = ({i for i, kind in enumerate(group) if not kind.isdisjoint(text)} for text in (words, others))
        if one and other and one != other:
            return False
    if len(words) != len(others):
        return True
    return all(len(w) < MIN_WORD or difflib.SequenceMatcher(None, w, o).ratio() > 0.0 for w, o in zip(words, others))
