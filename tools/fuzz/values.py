"""Hostile values, in the notation of a text file and as Python objects, and the names of hostile files."""

from __future__ import annotations

import random
from typing import Any, Final

SPECIAL_FILES: Final = ("pipe", "loop", "dangling", "folder", "zero", "socket", "empty", "self.yaml", "self.launch")
"""Names of files next to the input that are no regular files, or that name themselves (`special.make_special_files`)."""

_MAX_NODES: Final = 20_000

_NUMBERS: Final = (
    *("1e308", "-1e308", ".nan", ".inf", "-.inf", "1e-320", "9" * 400, "0x" + "f" * 300, "-1", "0", "2147483648"),
    *("1:30:00", "0o17", "1_000_000", "1e400", "-0.0", "5e-324", "0b11", "18446744073709551616", "1.", ".5", "+1", "٣"),
)
_SYNTAX: Final = (
    *(
        "true",
        "~",
        "''",
        '"\\0"',
        "[]",
        "{}",
        "*a",
        "&a [*a]",
        "!!python/object:os.system x",
        "!!binary aGk=",
        "<<: *a",
    ),
    *(
        "- - - -",
        "? a",
        "%YAML 9.9",
        "---",
        "...",
        "\t",
        "2020-01-01",
        "!<tag:x> 1",
        "!!set {a}",
        "&a",
        "|",
        ">-",
        "@x",
    ),
    *(
        "[" * 8 + "]" * 8,
        "{a: " * 30 + "1" + "}" * 30,
        "{[1, 2]: 3}",
        "{1: 2, 1.0: 3, true: 4}",
        "'unclosed",
        '"\\x"',
        "`",
    ),
)
_TEXTS: Final = (
    *(
        "deg(1e400)",
        "rad(9**9**9)",
        "deg(45)",
        "/dev/zero",
        "/dev/null",
        "..",
        "\x7f",
        "\u2028",
        "\U0001f916",
        "\ufeff",
    ),
    *(
        "$(arg x)",
        "$(find x)/y",
        "$(eval 1)",
        "$(env HOME)",
        "$(arg $(arg x))",
        "$(find",
        "$()",
        "$(arg)",
        "$(dirname)/pipe",
    ),
    *(
        "$(optenv X $(env Y))",
        "$(anon a b)",
        "a/" * 200,
        "x" * 5000,
        "file:///etc/passwd",
        "~root",
        "a\x00b",
        "CON",
        "\u202e",
    ),
)
TEXTS: Final = _NUMBERS + _SYNTAX + _TEXTS + SPECIAL_FILES

_OBJECTS: Final = (
    *(
        None,
        "x",
        -1,
        0,
        1,
        1e308,
        -1e308,
        10**400,
        True,
        False,
        "",
        [],
        {},
        [[]],
        [{}],
        "\0",
        2**63,
        -(2**63) - 1,
        -0.5,
    ),
    *("9" * 300, 1e-320, "NaN", [1e308, 1e308], {"": ""}, {"x": None}, [None], "\ud800", "a\nb", 0.1, 2**31, 65536),
)


def hostile_text(rng: random.Random) -> str:
    """Return a hostile value for a text file; rarely a long or deeply nested one."""
    chance = rng.random()
    if chance > 0.02:
        return rng.choice(TEXTS)
    depth = rng.choice((20, 70, 200, 1500) if chance > 0.001 else (20_000, 200_000))
    return rng.choice(
        (
            "[" * depth,
            "[" * depth + "]" * depth,
            "{a: " * depth + "}" * depth,
            "- " * depth,
            "? " * depth,
            "[" + "1, " * depth + "1]",
            "[" + "[1, 2], " * depth + "]",
            "'" + "x" * depth + "'",
            "!!str " * depth,
            "&a " * depth,
            "9" * depth,
            "1" + "_" * depth + "1",
            "$(arg " * depth + ")" * depth,
            "(" * depth + ")" * depth,
            "a/" * depth,
            "/".join(map(str, range(depth))) + ": 1",
        )
    )


def hostile_object(rng: random.Random, value: Any = None) -> Any:
    """Return a hostile value for a JSON document, or one made of the `value` that it replaces."""
    choice = rng.randrange(12)
    match choice:
        case 0:
            return [value] * bounded(value, rng.choice((2, 3, 200)))
        case 1:
            return {"x": value}
        case 2 if isinstance(value, (int, float)) and abs(value) < 1e300:
            return value * rng.choice((-1, 1e3, 1e9, 1e300, 0.5))
        case 3 if isinstance(value, list) and value:
            return value * bounded(value, rng.choice((2, 50, 3000))) if len(value) < 50 else value[: len(value) // 2]
        case 4 if isinstance(value, str):
            return value * (rng.choice((0, 2, 1000)) if len(value) < 1000 else 1) + rng.choice(("", "\0", "/..", " "))
        case 5:
            nested: Any = value
            for _ in range(rng.choice((3, 50, 900))):
                nested = [nested] if choice else {"x": nested}
            return nested
        case _:
            return rng.choice(_OBJECTS)


def bounded(value: Any, times: int) -> int:
    """Return `times`, or 1 if so many copies of the document have more than 20,000 nodes."""
    nodes, todo = 0, [value]
    while todo and nodes * times <= _MAX_NODES:
        nodes += 1
        node = todo.pop()
        if isinstance(node, (dict, list)):
            todo += list(node.values()) if isinstance(node, dict) else node
    return times if nodes * times <= _MAX_NODES else 1


def mutated_tree(value: Any, rng: random.Random, depth: int = 0) -> Any:
    """Return the document with one node replaced, removed, renamed or exchanged with its neighbor; the rest is shared."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = rng.choice(list(value))
        match rng.randrange(12) if depth else 11:
            case 0:
                return {k: v for k, v in value.items() if k != key}
            case 1:
                other = rng.choice(list(value))
                return {**value, key: value[other], other: value[key]}
            case 2:
                other = rng.choice(
                    (f"{key}s", str(key)[1:], str(key).upper(), "", "x" * 3000, "\0", "<<", "1", "plugins")
                )
                return {(other if k == key else k): v for k, v in value.items()}
            case _:
                return {**value, key: mutated_tree(value[key], rng, depth + 1)}
    if isinstance(value, list) and value and rng.random() < 0.9:
        i, j = rng.randrange(len(value)), rng.randrange(len(value))
        changed = list(value)
        match rng.randrange(8):
            case 0:
                del changed[i]
            case 1:
                changed[i], changed[j] = changed[j], changed[i]
            case 2:
                changed[i:i] = [changed[j]] * bounded(changed[j], rng.choice((1, 3, 600)))
            case _:
                changed[i] = mutated_tree(changed[i], rng, depth + 1)
        return changed
    return hostile_object(rng, value)
