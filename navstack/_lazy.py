"""Faces of packages: names that are imported when they are first used.

A command needs a few of the names of a package, and importing all of them takes seconds (numba, scipy, matplotlib, every
planner). The `__init__.py` of a package lists its names below `if TYPE_CHECKING`, where editors and type checkers read
them; `lazy_face` reads the same lines, so that each name stands there once.
"""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Callable
from typing import Any


def lazy_face(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package.

    Args:
        package: its name, such as `navstack.core`. Its `__init__.py` has `from module import name as name` below
            `if TYPE_CHECKING`.
    """
    where: dict[str, tuple[str, str]] = {}
    loader: Any = sys.modules[package].__loader__  # not a path: an archive has none
    for statement in ast.parse(loader.get_source(package)).body:
        if (
            isinstance(statement, ast.If)
            and isinstance(statement.test, ast.Name)
            and statement.test.id == "TYPE_CHECKING"
        ):
            for node in statement.body:
                if isinstance(node, ast.ImportFrom) and node.module is not None:
                    where |= {alias.asname or alias.name: (node.module, alias.name) for alias in node.names}

    def getattr_(name: str) -> Any:
        if name not in where:
            raise AttributeError(f"module {package!r} has no attribute {name!r}", name=name, obj=None)
        module, original = where[name]
        value = _member(module, original)
        setattr(importlib.import_module(package), name, value)
        return value

    return getattr_, lambda: sorted(where), sorted(where)


def _member(module: str, name: str) -> Any:
    """Return a name of a module, or a module of a package."""
    found = importlib.import_module(module)
    return getattr(found, name) if hasattr(found, name) else importlib.import_module(f"{module}.{name}")
