"""YAML values with their locations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from navstack.parameters.findings import Location


@dataclass(slots=True)
class ScalarNode:
    """A scalar: text, number, boolean or None."""

    value: Any
    at: Location
    quoted: bool = False
    text: str = ""
    """As written."""
    size: int = 1


@dataclass(slots=True)
class ListNode:
    """A sequence."""

    items: list[Node]
    at: Location
    size: int = 1
    """Number of values in it, itself included."""


@dataclass(slots=True)
class DictNode:
    """A mapping: key -> (location of the key, value)."""

    items: dict[str, tuple[Location, Node]]
    at: Location
    size: int = 1
    """Number of values in it, itself included."""


Node = ScalarNode | ListNode | DictNode


def plain(node: Node) -> Any:
    """Return the node as Python values."""
    if isinstance(node, ScalarNode):
        return node.value
    if isinstance(node, ListNode):
        return [plain(n) for n in node.items]
    return {k: plain(n) for k, (_, n) in node.items.items()}


def relocate(node: Node, at: Location) -> None:
    """Set the location of a node and of everything in it: an argument or attribute has one location."""
    node.at = at
    if isinstance(node, ListNode):
        for item in node.items:
            relocate(item, at)
    elif isinstance(node, DictNode):
        for key, (_, item) in node.items.items():
            node.items[key] = (at, item)
            relocate(item, at)


def shortened(text: str) -> str:
    """Return a text for a message, cut to 40 characters."""
    return text if len(text) <= 40 else text[:37] + "..."
