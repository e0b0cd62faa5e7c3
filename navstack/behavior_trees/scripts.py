"""The scripts of BehaviorTree.CPP: `speed := 0.5; tries += 1; battery < 20 && !charging ? 'dock' : 'drive'`.

A script is text of a file, so it is parsed here and never evaluated by Python: numbers (float64), strings in single quotes,
entries of the blackboard, and the operators of the table below. Truth is 1 or 0, and `&&` and `||` evaluate both sides, as in
BehaviorTree.CPP.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from navstack.behavior_trees.blackboard import ANY, TYPES, UNSET, Blackboard, Entry, StampedPose, format_number
from navstack.behavior_trees.errors import ScriptError

Value = object
Expression = Callable[[Blackboard], Value]

MAX_LENGTH: Final = 10_000
"""Longest script (characters)."""
MAX_DIGITS: Final = 100
"""Longest number of a script (characters)."""
MAX_DEPTH: Final = 50
"""Deepest nesting of a script."""
MAX_TEXT: Final = 100_000
"""Longest text that a script may make (characters)."""
_EQUAL: Final = 2.0**-23
"""Two numbers are equal within the epsilon of float32, as in BehaviorTree.CPP."""

_TOKEN: Final = re.compile(
    r"(?P<space>[ \t\r\n]+)|(?P<string>'[^']*')|(?P<hex>0[xX][0-9a-fA-F]+)|(?P<number>\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)"
    r"|(?P<name>[A-Za-z_@][A-Za-z0-9_]*)|(?P<operator>\.\.|&&|\|\||==|!=|<=|>=|:=|\+=|-=|\*=|/=|[-+*/&|^~!<>=?:();])"
)
_ASSIGN: Final = (":=", "=", "+=", "-=", "*=", "/=")
_COMPARE: Final = ("==", "!=", "<", ">", "<=", ">=")
_LEVEL: Final[dict[str, int]] = {
    **dict.fromkeys(_ASSIGN, 2),
    "?": 4,
    "||": 6,
    "&&": 8,
    **dict.fromkeys(_COMPARE, 10),
    "|": 12,
    "^": 12,
    "&": 14,
    **dict.fromkeys(("+", "-", ".."), 16),
    "*": 18,
    "/": 18,
}
"""How tightly each operator binds, the loosest first."""
_PREFIX_LEVEL: Final = 20


class _Token(NamedTuple):
    kind: str
    text: str
    position: int


class Script:
    """A parsed script. Call it with a blackboard to evaluate its statements; it returns the value of the last one."""

    __slots__ = ("_statements", "source")

    def __init__(self, source: str, enums: Mapping[str, int] | None = None) -> None:
        """Parse a script; `enums` are names of constants. Raises ScriptError."""
        self.source = source
        self._statements = tuple(_Parser(source, enums or {}).statements())

    def __call__(self, blackboard: Blackboard) -> Value:
        """Evaluate the script. Raises ScriptError."""
        value: Value = 1.0
        for statement in self._statements:
            value = statement(blackboard)
        return value

    def is_true(self, blackboard: Blackboard) -> bool:
        """Evaluate the script as a condition. Raises ScriptError for a value that is neither a number nor true or false."""
        return _truth(self(blackboard))


def _tokens(source: str) -> list[_Token]:
    if len(source) > MAX_LENGTH:
        raise ScriptError(f"the script has {len(source)} characters; the most is {MAX_LENGTH}")
    found: list[_Token] = []
    position = 0
    while position < len(source):
        match = _TOKEN.match(source, position)
        kind = match.lastgroup if match is not None else None
        if match is None or kind is None:
            rest = source[position : position + 10]
            fix = "close the string with a single quote" if rest.startswith("'") else "remove it"
            raise ScriptError(f'unexpected "{rest}"; {fix}', position)
        if kind != "space":
            found.append(_Token(kind, match.group(), position))
        after = source[match.end() : match.end() + 1]
        if kind in ("number", "hex") and (
            after.isalpha() or after == "_" or (after == "." and source[match.end() :][:2] != "..")
        ):
            raise ScriptError(f'"{match.group()}{after}" is not a number', position)
        position = match.end()
    return [*found, _Token("end", "", len(source))]


class _Parser:
    """A parser by precedence; each rule returns a function of the blackboard."""

    def __init__(self, source: str, enums: Mapping[str, int]) -> None:
        self._tokens = _tokens(source)
        self._enums = enums
        self._at = 0
        self._depth = 0

    def statements(self) -> list[Expression]:
        found: list[Expression] = []
        while self._next.kind != "end":
            found.append(self._expression(0))
            if self._next.text != ";" and self._next.kind != "end":
                raise ScriptError(f'unexpected "{self._next.text}"; separate statements with ;', self._next.position)
            while self._next.text == ";":
                self._at += 1
        if not found:
            raise ScriptError("the script is empty; write an expression")
        return found

    @property
    def _next(self) -> _Token:
        return self._tokens[self._at]

    def _take(self) -> _Token:
        token = self._next
        if token.kind != "end":
            self._at += 1
        return token

    def _expect(self, text: str) -> None:
        token = self._take()
        if token.text != text:
            raise ScriptError(
                f'"{text}" is missing' + (f' before "{token.text}"' if token.text else ""), token.position
            )

    def _expression(self, level: int) -> Expression:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise ScriptError(f"the script is nested more than {MAX_DEPTH} deep; split it", self._next.position)
        left, name = self._operand()
        while (binds := _LEVEL.get(self._next.text, -1)) > level and self._next.kind == "operator":
            token = self._take()
            if token.text in _ASSIGN:
                if name is None:
                    raise ScriptError("only an entry of the blackboard can be assigned to", token.position)
                left = _assignment(name, token.text, self._expression(binds - 1))
            elif token.text == "?":
                then = self._expression(0)
                self._expect(":")
                left = _choice(left, then, self._expression(binds - 1))
            elif token.text in _COMPARE:
                left = self._comparison(left, token.text)
            else:
                left = _binary(left, token.text, self._expression(binds))
            name = None
        self._depth -= 1
        return left

    def _comparison(self, left: Expression, operator: str) -> Expression:
        """A chain `a < b <= c` is true if each of its comparisons is."""
        chain = [(operator, self._expression(_LEVEL[operator]))]
        while self._next.text in _COMPARE:
            operator = self._take().text
            chain.append((operator, self._expression(_LEVEL[operator])))
        enums = self._enums

        def evaluate(board: Blackboard) -> Value:
            first = left(board)
            for operator, operand in chain:
                second = operand(board)
                if not _compare(first, operator, second, enums):
                    return 0.0
                first = second
            return 1.0

        return evaluate

    def _operand(self) -> tuple[Expression, str | None]:
        """Return an operand, and the key if it is an entry."""
        token = self._take()
        match token.kind, token.text:
            case "operator", ("-" | "~" | "!") as operator:
                return _unary(operator, self._expression(_PREFIX_LEVEL)), None
            case "operator", "(":
                inner = self._expression(0)
                self._expect(")")
                return inner, None
            case "number" | "hex", text:
                if len(text) > MAX_DIGITS:
                    raise ScriptError(f"a number of more than {MAX_DIGITS} characters", token.position)
                number = float(int(text, 16)) if token.kind == "hex" else float(text)
                return (lambda _: number), None
            case "string", text:
                return (lambda _: text[1:-1]), None
            case "name", ("true" | "false") as word:
                truth = 1.0 if word == "true" else 0.0
                return (lambda _: truth), None
            case "name", name if name in self._enums:
                constant = float(self._enums[name])
                return (lambda _: constant), None
            case "name", name:
                return _read(name), name
            case "end", _:
                raise ScriptError("the script ends too early: an operand is missing", token.position)
            case _:
                raise ScriptError(f'unexpected "{token.text}"; an operand is missing', token.position)


# --- evaluation --------------------------------------------------------------------------------------------------------


def _read(key: str) -> Expression:
    def evaluate(board: Blackboard) -> Value:
        entry = board.find(key)
        if entry is None:
            raise ScriptError(f'the blackboard has no entry "{key}"; create it with {key} := ..')
        if entry.value is UNSET:
            raise ScriptError(f'nothing has been written to the entry "{key}" yet')
        return entry.value

    return evaluate


def _number(value: Value) -> float | None:
    return float(value) if isinstance(value, (int, float)) else None


def _named_number(text: str, enums: Mapping[str, int]) -> float:
    """Return the number that a text stands for, to compare it with a number."""
    if text in ("true", "false"):
        return float(text == "true")
    if text in enums:
        return float(enums[text])
    try:
        return float(text)
    except ValueError:
        raise ScriptError(f"the text '{text:.40}' cannot be compared with a number") from None


def _truth(value: Value) -> bool:
    number = _number(value)
    if number is not None:
        return number != 0.0
    if value in ("true", "false"):
        return value == "true"
    raise ScriptError(f"{value!r:.40} is neither true nor false; compare it with a value")


def _compare(left: Value, operator: str, right: Value, enums: Mapping[str, int]) -> bool:
    a: float | str
    b: float | str
    if isinstance(left, str) and isinstance(right, str):
        a, b = left, right
        same = a == b
    else:
        first = _named_number(left, enums) if isinstance(left, str) else _number(left)
        second = _named_number(right, enums) if isinstance(right, str) else _number(right)
        if first is None or second is None:
            raise ScriptError(f"{type(left).__name__} and {type(right).__name__} cannot be compared with {operator}")
        a, b = first, second
        same = abs(a - b) <= _EQUAL or a == b
    match operator:
        case "==":
            return same
        case "!=":
            return not same
        case "<":
            return not a >= b  # pyright: ignore[reportOperatorIssue]
        case ">":
            return not a <= b  # pyright: ignore[reportOperatorIssue]
        case "<=":
            return not a > b  # pyright: ignore[reportOperatorIssue]
        case _:
            return not a < b  # pyright: ignore[reportOperatorIssue]


def _unary(operator: str, operand: Expression) -> Expression:
    def evaluate(board: Blackboard) -> Value:
        value = _number(operand(board))
        if value is None:
            raise ScriptError(f"the operator {operator} needs a number")
        if operator == "-":
            return -value
        if operator == "!":
            return float(value == 0.0)
        return float(~_integer(value, operator))

    return evaluate


def _integer(value: float, operator: str) -> int:
    if not math.isfinite(value) or value != int(value) or abs(value) >= 2.0**63:
        raise ScriptError(f"the operator {operator} needs integers, not {value:g}")
    return int(value)


def _divided(a: float, b: float) -> float:
    if b != 0.0:
        return a / b
    return math.nan if a == 0.0 or math.isnan(a) else math.copysign(math.inf, a) * math.copysign(1.0, b)


def _joined(a: str, b: str) -> str:
    if len(a) + len(b) > MAX_TEXT:
        raise ScriptError(f"a text of more than {MAX_TEXT} characters")
    return a + b


def _text(value: Value) -> str:
    return value if isinstance(value, str) else format_number(value) if isinstance(value, (int, float)) else ""


def _combined(left: Value, operator: str, right: Value) -> Value:
    a, b = _number(left), _number(right)
    if a is None or b is None:
        texts = (isinstance(left, str) or a is not None) and (isinstance(right, str) or b is not None)
        both = isinstance(left, str) and isinstance(right, str)
        if (operator == ".." and texts) or (operator == "+" and both):
            return _joined(_text(left), _text(right))
        raise ScriptError(f"the operator {operator} does not apply to {_kind(left)} and {_kind(right)}")
    match operator:
        case "+":
            return a + b
        case "-":
            return a - b
        case "*":
            return a * b
        case "/":
            return _divided(a, b)
        case "&&":
            return float(a != 0.0 and b != 0.0)
        case "||":
            return float(a != 0.0 or b != 0.0)
        case "&":
            return float(_integer(a, "&") & _integer(b, "&"))
        case "|":
            return float(_integer(a, "|") | _integer(b, "|"))
        case "^":
            return float(_integer(a, "^") ^ _integer(b, "^"))
        case _:
            raise ScriptError(f"the operator {operator} needs a text on one side")


def _kind(value: Value) -> str:
    if isinstance(value, str):
        return "a text"
    return (
        "a number"
        if isinstance(value, (int, float))
        else "a pose"
        if isinstance(value, StampedPose)
        else "another value"
    )


def _binary(left: Expression, operator: str, right: Expression) -> Expression:
    return lambda board: _combined(left(board), operator, right(board))


def _choice(condition: Expression, then: Expression, other: Expression) -> Expression:
    def evaluate(board: Blackboard) -> Value:
        value = condition(board)
        chosen = bool(value) if isinstance(value, str) else _truth(value)
        return then(board) if chosen else other(board)

    return evaluate


def _assignment(key: str, operator: str, right: Expression) -> Expression:
    def evaluate(board: Blackboard) -> Value:
        entry = board.find(key)
        if entry is None:
            if operator != ":=":
                raise ScriptError(f'the blackboard has no entry "{key}"; create it with := instead of {operator}')
            entry = board.entry(key)
        value = right(board)
        if operator not in (":=", "="):
            if entry.value is UNSET:
                raise ScriptError(f'nothing has been written to the entry "{key}" yet')
            value = _combined(entry.value, operator[0], value)
        entry.set(_as_type(entry, value))
        return entry.value

    return evaluate


def _as_type(entry: Entry, value: Value) -> Value:
    """Return a value as the type of the entry: that of its ports, otherwise that of its value so far."""
    kind = TYPES.get(entry.type)
    if kind is None:
        if entry.type != ANY:
            raise ScriptError(f'the entry "{entry.key}" is of type {entry.type}: a script cannot write it')
        before = entry.value
        if isinstance(before, (int, float)) and isinstance(value, str):
            return _named_number(value, {})
        if isinstance(before, str) and isinstance(value, float):
            return format_number(value)
        return _plain(value)
    if type(value) in kind.plain:
        return value
    try:
        return kind.parse(value) if isinstance(value, str) else kind.convert(value)
    except ValueError as exc:
        raise ScriptError(
            f'the entry "{entry.key}" is of type {entry.type}, but the value is {value!r:.40} ({exc})'
        ) from None


def _plain(value: Value) -> Value:
    """Return whole numbers as integers: an entry that a script creates may be an index."""
    return int(value) if isinstance(value, float) and abs(value) < 2.0**53 and value.is_integer() else value
