"""Mutations of text files: bytes, lines, values, encodings; of YAML documents also nodes, aliases and nesting."""

from __future__ import annotations

import random
from functools import cache
from typing import Any, Final

import yaml

from tools.fuzz.values import hostile_text, mutated_tree

_ENCODINGS: Final = ("utf-16", "utf-16-le", "utf-32", "utf-8-sig", "utf-7", "latin-1", "cp1252", "cp037")
_BREAKS: Final = (b"\r", b"\r\n", b"\n\r", b"\xc2\x85", b"\xe2\x80\xa8", b"\n\n", b"\x0b", b"\x0c")
_MARK: Final = "Z9Z"
"""A scalar that the dumper writes plain; hostile text takes its place."""


def mutated_bytes(data: bytes, rng: random.Random) -> bytes:
    """Change, remove, repeat or overwrite some bytes, or cut the end off."""
    if not data:
        return bytes([rng.randrange(256)])
    i = rng.randrange(len(data))
    j = min(len(data), i + rng.choice((1, 1, 4, 64, 4096)))
    match rng.randrange(6):
        case 0:
            return data[:i] + bytes([rng.randrange(256)]) + data[i + 1 :]
        case 1:
            return data[:i] + data[j:]
        case 2:
            return data[:j] + data[i:j] * rng.choice((1, 3)) + data[j:]
        case 3:
            return data[:i]
        case 4:
            return data[:i] + bytes([data[i] ^ (1 << rng.randrange(8))]) + data[i + 1 :]
        case _:
            return data[:i] + rng.choice((b"\xff" * 4, b"\x00" * 8, b"\x7f\xff\xff\xff", rng.randbytes(4))) + data[j:]


def mutated_text(data: bytes, rng: random.Random) -> bytes:
    """Change bytes, lines, values or the encoding of a text, one to eight times."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        data = _changed(data, rng)
    return data


def _changed(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(20):
        case 0 | 1:
            return mutated_bytes(data, rng)
        case 2 | 3:
            del lines[i]
        case 4 | 5:
            lines[i], lines[j] = lines[j], lines[i]
        case 6:
            lines[i:i] = [lines[j]] * rng.choice((1, 2, 50))
        case 7 | 8:
            lines[i] = b" " * rng.randrange(9) + lines[i].lstrip() if rng.random() < 0.8 else b"\t" + lines[i]
        case 9:
            return _encoded(data, rng)
        case 10:
            lines[i:i] = lines[j : j + rng.choice((2, 5, 20))]
        case 11:
            at = rng.randrange(len(data) + 1)
            return (
                data[:at]
                + rng.choice((b"\0", b"\xef\xbb\xbf", b"\xed\xa0\x80", b"\xff", b"\x1b[2J", b"\x08"))
                + data[at:]
            )
        case _:
            return with_hostile_value(data, rng)
    return b"\n".join(lines)


def _encoded(data: bytes, rng: random.Random) -> bytes:
    if rng.random() < 0.4:
        return data.replace(b"\n", rng.choice(_BREAKS))
    return data.decode("utf-8", "replace").encode(rng.choice(_ENCODINGS), "replace")


def with_hostile_value(data: bytes, rng: random.Random) -> bytes:
    """Replace what is between two separators by a hostile value."""
    marks = [i for i, byte in enumerate(data) if byte in b": ,[]{}\"'\n<>="]
    if not marks:
        return data
    at = rng.randrange(len(marks))
    end = marks[min(at + rng.choice((1, 1, 2, 3)), len(marks) - 1)]
    return data[: marks[at] + 1] + _bytes(hostile_text(rng)) + data[end:]


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")


def mutated_yaml(data: bytes, rng: random.Random) -> bytes:
    """Change the text, or the nodes, aliases and nesting of a YAML document that is valid before."""
    match rng.randrange(10):
        case 0 | 1 | 2 | 3:
            return mutated_text(data, rng)
        case 4 | 5 | 6 | 7:
            tree = _parsed(data)
            for _ in range(rng.choice((1, 1, 2, 4))):
                tree = mutated_tree(tree, rng)
            return _dumped(tree, rng)
        case 8:
            return _with_aliases(data, rng)
        case _:
            return mutated_text(_dumped(mutated_tree(_parsed(data), rng), rng), rng)


@cache
def _parsed(data: bytes) -> Any:
    return yaml.load(data, Loader=yaml.SafeLoader)


def _dumped(tree: Any, rng: random.Random) -> bytes:
    """Write the document, in some cases with hostile text in the place of one value."""
    if rng.random() < 0.4:
        tree = _with_mark(tree, rng)
    try:
        text = yaml.dump(
            tree, Dumper=yaml.CSafeDumper, sort_keys=False, default_flow_style=rng.choice((None, True, False))
        )
    except (yaml.YAMLError, UnicodeEncodeError, RecursionError, ValueError):
        return b"[" * rng.choice((900, 1100, 5000))
    return _bytes(text.replace(_MARK, hostile_text(rng)))


def _with_mark(value: Any, rng: random.Random) -> Any:
    if isinstance(value, dict) and value and rng.random() < 0.85:
        key = rng.choice(list(value))
        return {**value, key: _with_mark(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.85:
        i = rng.randrange(len(value))
        return [*value[:i], _with_mark(value[i], rng), *value[i + 1 :]]
    return _MARK


def _with_aliases(data: bytes, rng: random.Random) -> bytes:
    """Put anchors before the document and use them in it: chains that expand, merges, anchors that hold themselves."""
    levels, width = rng.choice(((1, 2), (3, 10), (9, 10), (9, 100), (30, 2), (200, 2), (2, 5000)))
    kind = rng.randrange(4)
    if kind == 0:
        head = ["a0: &a0 [" + ", ".join(["1"] * width) + "]"]
        head += [f"a{i}: &a{i} [" + ", ".join([f"*a{i - 1}"] * width) + "]" for i in range(1, levels)]
    elif kind == 1:
        head = ["a0: &a0 {k: 1}"]
        head += [
            f"a{i}: &a{i} {{" + ", ".join(f"k{n}: *a{i - 1}" for n in range(min(width, 100))) + "}"
            for i in range(1, levels)
        ]
    elif kind == 2:
        head = ["a0: &a0 {k: 1}", *(f"a{i}: &a{i} {{<<: *a{i - 1}, k{i}: 1}}" for i in range(1, levels))]
    else:
        head = ["a0: &a0 [*a0]" if rng.random() < 0.5 else f"a0: &a0 {'x' * width * 10}"]
        levels = 1
    body = data
    for _ in range(rng.choice((0, 1, 2, 8))):
        body = _with_alias(body, rng.choice((f"*a{levels - 1}", "*a0", f"*a{levels}", f"{{<<: *a{levels - 1}}}")), rng)
    return "\n".join(head).encode() + b"\n" + body


def _with_alias(data: bytes, alias: str, rng: random.Random) -> bytes:
    marks = [i for i, byte in enumerate(data) if byte in b": ,[\n"]
    at = rng.randrange(len(marks))
    end = marks[min(at + 1, len(marks) - 1)]
    return data[: marks[at] + 1] + b" " + alias.encode() + data[end:]
