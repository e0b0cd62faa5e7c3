"""Evaluate the Python expressions of launch files, xacro and `rad(..)` without executing Python: by their syntax tree.

Allowed are numbers, texts, lists, names and functions that the caller gives, arithmetic, comparisons, `and`, `or`, `not`,
`a if b else c`, indices and the methods of texts in TEXT_METHODS. Everything else is a ValueError.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

MAX_CHARS = 2_000
"""Longest expression, and longest text that it may make."""
MAX_POWER = 1_000.0
"""Largest exponent: the time of larger powers of integers has no bound."""
MAX_INTEGER = 10**30
"""Largest integer that an operation takes or makes."""

TEXT_METHODS = frozenset({"lower", "upper", "strip", "startswith", "endswith", "split", "replace"})


def _rounded(value: float, digits: int = 0) -> float:
    """`round`, whose time grows with the number of digits."""
    if abs(digits) > MAX_POWER:
        raise ValueError(f"round with {digits} digits is not evaluated here")
    return round(value, digits) if digits else round(value)


MATH: dict[str, Any] = {
    **{name: getattr(math, name) for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sqrt", "floor")},
    **{name: getattr(math, name) for name in ("ceil", "radians", "degrees", "hypot", "exp", "log", "fabs", "fmod")},
    "pi": math.pi,
    "e": math.e,
    "tau": math.tau,
    "inf": math.inf,
    "int": int,
    "float": float,
    "str": str,
    "len": len,
    "abs": abs,
    "min": min,
    "max": max,
    "round": _rounded,
    "bool": bool,
    "True": True,
    "False": False,
    "true": True,
    "false": False,
    "None": None,
}
"""Names of numbers and functions that every expression may use."""


def _is_in(item: Any, container: Any) -> bool:
    return item in container


def _is_not_in(item: Any, container: Any) -> bool:
    return item not in container


_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: _is_in,
    ast.NotIn: _is_not_in,
    ast.Is: operator.eq,
    ast.IsNot: operator.ne,
}


def evaluate(text: str, names: Mapping[str, Any]) -> Any:
    """Return the value of an expression with these names of values and functions; raise ValueError with the reason."""
    if len(text) > MAX_CHARS:
        raise ValueError(f"it is longer than {MAX_CHARS:,} characters")
    try:
        tree = ast.parse(text.strip(), mode="eval")
        return _value(tree.body, names)
    except ValueError:
        raise
    except KeyError as exc:
        raise ValueError(f"{exc.args[0]} has no value") from exc
    except ZeroDivisionError as exc:
        raise ValueError("it divides by zero") from exc
    except (RecursionError, MemoryError) as exc:
        raise ValueError("it is nested too deep") from exc
    except SyntaxError as exc:
        raise ValueError(f"its syntax is invalid ({exc.msg})") from exc
    except (TypeError, OverflowError, IndexError, AttributeError) as exc:
        raise ValueError(str(exc)) from exc


def _value(node: ast.AST, names: Mapping[str, Any]) -> Any:
    match node:
        case ast.Constant(value) if isinstance(value, (int, float, str, bool)) or value is None:
            return _bounded(value)
        case ast.Name(name):
            return names[name]
        case ast.Attribute(ast.Name("math"), name) if isinstance(MATH.get(name), float):
            return MATH[name]
        case ast.BinOp(left, op, right) if type(op) in _OPERATORS:
            return _binary(op, _value(left, names), _value(right, names))
        case ast.UnaryOp(op, operand) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value(operand, names))
        case ast.BoolOp(op, values):
            return _logical(isinstance(op, ast.And), values, names)
        case ast.IfExp(test, body, orelse):
            return _value(body if _value(test, names) else orelse, names)
        case ast.Compare(left, ops, comparators):
            return _compared(_value(left, names), ops, comparators, names)
        case ast.List(elements) | ast.Tuple(elements):
            return _bounded([_value(element, names) for element in elements])
        case ast.Subscript(value, ast.Slice(lower, upper, None)):
            low, high = (None if end is None else _value(end, names) for end in (lower, upper))
            return _value(value, names)[low:high]
        case ast.Subscript(value, index):
            return _value(value, names)[_value(index, names)]
        case ast.Call(function, arguments, []):
            return _called(function, [_value(argument, names) for argument in arguments], names)
        case _:
            raise ValueError(f"`{ast.unparse(node)[:60]}` is not evaluated here")


def _bounded(value: Any) -> Any:
    """The value; ValueError for one that grows without end."""
    if isinstance(value, int) and abs(value) > MAX_INTEGER:
        raise ValueError("an integer in it is too large")
    if isinstance(value, (str, list)) and _size(value) > MAX_CHARS:
        raise ValueError(f"a text or list in it is longer than {MAX_CHARS:,}")
    return value


def _size(value: Any) -> int:
    """Characters of a text; elements of a list with all that are in it, as often as they are in it."""
    match value:
        case str():
            return len(value)
        case list():
            return len(value) + sum(map(_size, value))
        case _:
            return 0


def _binary(op: ast.operator, left: Any, right: Any) -> Any:
    if isinstance(op, ast.Mod) and isinstance(left, str):
        raise ValueError("texts are not formatted here")
    if isinstance(op, ast.Pow) and abs(right) > MAX_POWER:
        raise ValueError(f"the exponent {right:g} is too large")
    if isinstance(op, ast.Pow) and isinstance(left, int) and isinstance(right, int) and abs(left) > 1 and right > 200:
        raise ValueError(f"the exponent {right} is too large for an integer")
    if isinstance(op, ast.Mult):
        for some, other in ((left, right), (right, left)):
            if isinstance(some, (str, list)) and isinstance(other, int) and _size(some) * other > MAX_CHARS:
                raise ValueError(f"a text or list in it is longer than {MAX_CHARS:,}")
    return _bounded(_OPERATORS[type(op)](left, right))


def _logical(both: bool, values: Sequence[ast.expr], names: Mapping[str, Any]) -> Any:
    value: Any = both
    for node in values:
        value = _value(node, names)
        if bool(value) is not both:
            return value
    return value


def _compared(left: Any, ops: Sequence[ast.cmpop], comparators: Sequence[ast.expr], names: Mapping[str, Any]) -> bool:
    for op, node in zip(ops, comparators):
        right = _value(node, names)
        if not _OPERATORS[type(op)](left, right):
            return False
        left = right
    return True


def _called(function: ast.AST, arguments: list[Any], names: Mapping[str, Any]) -> Any:
    match function:
        case ast.Name(name) if callable(names.get(name)):
            return _bounded(names[name](*arguments))
        case ast.Attribute(ast.Name("math"), name) if callable(getattr(math, name, None)) and name in MATH:
            return _bounded(MATH[name](*arguments))
        case ast.Attribute(value, method) if method in TEXT_METHODS:
            text = _value(value, names)
            if not isinstance(text, str):
                raise ValueError(f"`{ast.unparse(value)[:60]}` is not a text")
            return _bounded(getattr(text, method)(*arguments))
        case _:
            raise ValueError(f"the function `{ast.unparse(function)[:60]}` is not known here")
