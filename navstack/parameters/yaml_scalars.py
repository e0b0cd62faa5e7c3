"""YAML scalars as rosparam reads them: YAML 1.1, exponents without a dot, angles in degrees and radians."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable
from typing import Any

import yaml
from yaml.constructor import SafeConstructor

MAX_NUMBER_CHARS = 100
"""A longer plain scalar is text: reading it as a number takes quadratic time."""

INT, FLOAT, BOOL = "tag:yaml.org,2002:int", "tag:yaml.org,2002:float", "tag:yaml.org,2002:bool"
NULL, STR, MERGE = "tag:yaml.org,2002:null", "tag:yaml.org,2002:str", "tag:yaml.org,2002:merge"
EXPONENT, DEGREES, RADIANS = "exponent", "!degrees", "!radians"
_TEXTS = frozenset({STR, "tag:yaml.org,2002:timestamp", "tag:yaml.org,2002:value", "!"})

# YAML 1.1 wants a dot in a float; rosparam also reads 1e-3 as a number
_EXPONENT_PATTERN = re.compile(r"[-+]?(?:[0-9][0-9_]*(?:\.[0-9_]*)?|\.[0-9][0-9_]*)[eE][-+]?[0-9]+\Z")
_DEG = re.compile(r"deg\([^)]*\)\Z")
_RAD = re.compile(r"rad\([^)]*\)\Z")

_RESOLVERS: dict[str | None, list[tuple[str, re.Pattern[str]]]] = yaml.SafeLoader.yaml_implicit_resolvers  # type: ignore[assignment]
_CONSTRUCTOR: Any = SafeConstructor()
_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}


def _arithmetic(text: str) -> float:
    """Evaluate the arithmetic that rosparam allows in `rad(..)`: `pi/2`, `-2*pi`. Raise ValueError for anything else."""
    if len(text) > MAX_NUMBER_CHARS:
        raise ValueError(text)

    def value(node: ast.AST) -> float:
        match node:
            case ast.Expression(body):
                return value(body)
            case ast.Constant(v) if isinstance(v, (int, float)) and not isinstance(v, bool):
                return float(v)
            case ast.Name("pi"):
                return math.pi
            case ast.Attribute(ast.Name("math"), "pi"):
                return math.pi
            case ast.BinOp(left, op, right) if type(op) in _OPERATORS:
                return _OPERATORS[type(op)](value(left), value(right))
            case ast.UnaryOp(op, operand) if type(op) in _OPERATORS:
                return _OPERATORS[type(op)](value(operand))
            case _:
                raise ValueError(text)

    try:
        return value(ast.parse(text.strip(), mode="eval"))
    except (SyntaxError, ZeroDivisionError, OverflowError, RecursionError, MemoryError) as exc:
        raise ValueError(text) from exc


def _degrees(text: str) -> float:
    text = text.strip()
    return math.radians(float(text[4:-1] if _DEG.match(text) else text))


def _radians(text: str) -> float:
    text = text.strip()
    return _arithmetic(text[4:-1] if _RAD.match(text) else text)


def resolve(text: str) -> str:
    """Return the tag of a plain scalar."""
    if not text:
        return NULL
    if len(text) > MAX_NUMBER_CHARS:
        return STR
    for tag, pattern in _RESOLVERS.get(text[0], ()):
        if pattern.match(text):
            return tag
    first = text[0]
    if first in "+-.0123456789" and _EXPONENT_PATTERN.match(text):
        return EXPONENT
    if first == "d" and _DEG.match(text):
        return DEGREES
    if first == "r" and _RAD.match(text):
        return RADIANS
    return STR


def construct(tag: str, text: str) -> Any:
    """Return the value of a scalar; raise ValueError if the text does not fit the tag, LookupError for an unknown tag."""
    if tag in _TEXTS:
        return text
    if tag in (INT, FLOAT):
        if len(text) > MAX_NUMBER_CHARS:
            raise ValueError(text)
        node = yaml.ScalarNode(tag, text)
        return _CONSTRUCTOR.construct_yaml_int(node) if tag == INT else _CONSTRUCTOR.construct_yaml_float(node)
    if tag == EXPONENT:
        return float(text.replace("_", ""))
    if tag == BOOL:
        try:
            return SafeConstructor.bool_values[text.lower()]
        except KeyError as exc:
            raise ValueError(text) from exc
    if tag == NULL:
        return None
    if tag == DEGREES:
        return _degrees(text)
    if tag == RADIANS:
        return _radians(text)
    raise LookupError(tag)


def scalar(text: str) -> Any:
    """Return the value of a plain scalar; text that cannot be converted stays text."""
    try:
        return construct(resolve(text), text)
    except (ValueError, LookupError):
        return text
