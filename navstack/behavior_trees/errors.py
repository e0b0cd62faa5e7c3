"""What can be wrong with a behavior tree: its file, or a node while it runs."""

from __future__ import annotations

from navstack.core import InputError, NavError


class BehaviorTreeError(InputError):
    """The XML of a behavior tree is invalid. `data` holds `file`, `line` and `column` (from 1)."""

    code = 9060
    name = "INVALID_BEHAVIOR_TREE"


class BehaviorTreeRunError(NavError):
    """A node of a behavior tree cannot go on. `data` holds its `path` in the tree, `file` and `line`."""

    code = 9061
    name = "BEHAVIOR_TREE_FAILED"


class ScriptError(ValueError):
    """A script is invalid or cannot be evaluated; `position` is the index of the character, if known."""

    def __init__(self, message: str, position: int | None = None) -> None:
        super().__init__(message)
        self.position = position
