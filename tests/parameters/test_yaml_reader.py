"""YAML as rosparam reads it, with locations."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import yaml

from navstack.parameters.yaml_reader import DictNode, ListNode, ScalarNode, parse_yaml, plain, read_yaml
from tests.conftest import data_files


def values(text: str) -> Any:
    read = parse_yaml(text, "t.yaml")
    assert [f for f in read.findings if f.severity == "error"] == []
    return plain(read.root)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1),
        ("1.5", 1.5),
        ("1e-3", 1e-3),
        ("-2E+4", -2e4),
        (".5e1", 5.0),
        ("1.e3", 1000.0),
        ("0x10", 16),
        ("010", 8),
        ("1_000", 1000),
        ("1:30", 90),
        ("yes", True),
        ("Off", False),
        ("~", None),
        ("", None),
        ("deg(90)", math.pi / 2),
        ("rad(pi/2)", math.pi / 2),
        ("rad(-2*pi)", -2 * math.pi),
        ("!degrees 180", math.pi),
        ("!radians 2*pi", 2 * math.pi),
        ("!!str 12", "12"),
        ("!!float 3", 3.0),
        ("'1e-3'", "1e-3"),
        ("2020-01-01", "2020-01-01"),
        ("1e", "1e"),
        ("deg", "deg"),
    ],
)
def test_scalars(text: str, value: Any) -> None:
    read = values(f"a: {text}\n")["a"]
    assert read == value
    assert type(read) is type(value)


def test_every_key_and_value_is_located() -> None:
    root = parse_yaml("# c\na:\n  b: [1, {c: x}]\n", "t.yaml").root
    at, a = root.items["a"]
    assert (at.line, at.column) == (2, 1)
    assert isinstance(a, DictNode)
    at, b = a.items["b"]
    assert (at.line, at.column) == (3, 3)
    assert isinstance(b, ListNode)
    assert (b.at.line, b.at.column) == (3, 6)
    inner = b.items[1]
    assert isinstance(inner, DictNode)
    at, c = inner.items["c"]
    assert isinstance(c, ScalarNode)
    assert (at.line, at.column, c.at.line, c.at.column) == (3, 11, 3, 14)


def test_the_last_duplicate_wins_and_is_reported() -> None:
    read = parse_yaml("a:\n  b: 1\n  c: 2\n  b: 3\n", "t.yaml")
    assert plain(read.root) == {"a": {"b": 3, "c": 2}}
    (found,) = read.findings
    assert (found.severity, found.rule, found.line, found.key) == ("warning", "duplicated", 4, "a/b")
    assert "line 2" in found.message


def test_a_duplicate_with_the_same_value_is_an_info() -> None:
    assert [f.severity for f in parse_yaml("a: 1\na: 1\n", "t.yaml").findings] == ["info"]


def test_a_duplicated_namespace_is_replaced_as_a_whole() -> None:
    read = parse_yaml("a: {b: 1}\na: {c: 2}\n", "t.yaml")
    assert plain(read.root) == {"a": {"c": 2}}
    assert "replaces the first" in read.findings[0].message


def test_empty_files_bom_anchors_and_merge_keys() -> None:
    assert values("") == {}
    assert values("# only a comment\n") == {}
    assert values("---\n") == {}
    assert values("\ufeffa: 1\n".encode().decode("utf-8-sig")) == {"a": 1}
    assert values("a: &x {b: 1, c: 2}\nd: *x\ne: {<<: *x, c: 3}\n") == {
        "a": {"b": 1, "c": 2},
        "d": {"b": 1, "c": 2},
        "e": {"b": 1, "c": 3},
    }


def test_bom_in_a_file(tmp_path: Path) -> None:
    path = tmp_path / "bom.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1\n")
    assert plain(read_yaml(path).root) == {"a": 1}


@pytest.mark.parametrize(
    ("text", "rule", "line", "column", "word"),
    [
        ("a:\n\tb: 1\n", "tab", 2, 1, "spaces"),
        ("a: 1\t# c\n", "tab", 1, 5, "spaces"),
        ("a: [1\n", "yaml", 2, 1, "bracket"),
        ("a: 1\n b: 2\n", "yaml", 2, 3, "indentation"),
        ("- 1\n", "not-a-mapping", 1, 1, "name: value"),
        ("hello\n", "not-a-mapping", 1, 1, "hello"),
        ("dummy.yaml", "not-a-mapping", 1, 1, "symbolic link"),
        ("a: 1\n---\nb: 2\n", "not-one-document", 2, 1, "split"),
        ("1: 2\n", "key-not-text", 1, 1, "quote"),
        ("on: 2\n", "key-not-text", 1, 1, "boolean"),
        ("[a]: 2\n", "key-not-text", 1, 1, "name"),
        ("? {a: 1}\n: 2\n", "key-not-text", 1, 3, "name"),
        ("a: !!python/object:os.system x\n", "unknown-tag", 1, 4, "tag"),
        ("a: !!python/object/apply:os.system [x]\n", "unknown-tag", 1, 4, "tag"),
        ("a: !mine {b: 1}\n", "unknown-tag", 1, 4, "tag"),
        ("a: !!int x\n", "not-a-value", 1, 4, "type"),
        ("a: !degrees x\n", "not-a-value", 1, 4, "degrees"),
        ("a: !radians __import__('os')\n", "not-a-value", 1, 4, "radians"),
        ("a: rad(9**9**9)\n", "not-a-value", 1, 4, "radians"),
        ("a: &x [*x]\n", "yaml", 1, 8, "no end"),
        ("a: *x\n", "yaml", 1, 4, "anchor"),
        ("a: \x01\n", "yaml", 1, 4, "control"),
        ("a: \x00\n", "yaml", 1, 4, "control"),
    ],
)
def test_rejected_files_name_location_and_fix(text: str, rule: str, line: int, column: int, word: str) -> None:
    read = parse_yaml(text, "t.yaml")
    assert plain(read.root) == {}
    (found,) = [f for f in read.findings if f.severity == "error"]
    assert (found.rule, found.line, found.column) == (rule, line, column)
    assert word in found.message


def test_alias_bombs_depth_and_size_are_rejected(tmp_path: Path) -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 30)]
    assert [f.rule for f in parse_yaml("\n".join(lines), "t").findings] == ["alias-bomb"]
    assert [f.rule for f in parse_yaml("a: " + "[" * 100_000, "t").findings] == ["too-deep"]
    assert [f.rule for f in parse_yaml("".join(" " * i + "a:\n" for i in range(60)), "t").findings] == ["too-deep"]
    assert [f.rule for f in parse_yaml("[" + "1," * 100_000 + "1]", "t").findings] == ["too-large"]
    large = tmp_path / "large.yaml"
    large.write_text("# " + "x" * 1_000_000)
    assert [f.rule for f in read_yaml(large).findings] == ["too-large"]
    assert values("a: " + "1:" * 40_000 + "1")["a"].startswith("1:1")
    assert values("a: " + "9" * 90_000)["a"] == "9" * 90_000


def test_bytes_that_are_not_utf8_are_located(tmp_path: Path) -> None:
    path = tmp_path / "latin.yaml"
    path.write_bytes(b"a: 1\nb: caf\xe9\n")
    (found,) = read_yaml(path).findings
    assert (found.rule, found.line, found.column) == ("not-utf8", 2, 7)
    assert "UTF-8" in found.message


def test_an_image_and_utf16_as_parameters(tmp_path: Path) -> None:
    image, wide = tmp_path / "map.png", tmp_path / "wide.yaml"
    image.write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR")
    wide.write_text("a: 1\n", encoding="utf-16")
    texts = [read_yaml(path).findings[0].message for path in (image, wide)]
    assert texts[0].endswith("map.png is not a text file; name a YAML file")
    assert texts[1].endswith("is not valid UTF-8; save the file as UTF-8")


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    assert [f.rule for f in read_yaml(tmp_path / "none.yaml").findings] == ["cannot-read"]
    assert [f.rule for f in read_yaml(tmp_path).findings] == ["cannot-read"]


ROBOTS = data_files("params*/**/*.yaml")


@pytest.mark.slow
@pytest.mark.skipif(not ROBOTS, reason="no foreign data here")
def test_robots_files_read_as_pyyaml_reads_them() -> None:
    compared = 0
    for path in ROBOTS:
        text = path.read_text(encoding="utf-8")
        try:
            expected = yaml.safe_load(text)
        except yaml.YAMLError:
            continue  # !degrees, which only rosparam knows
        if not isinstance(expected, dict):
            continue
        assert plain(read_yaml(path).root) == _with_exponents(expected), path
        compared += 1
    assert compared > 100


def _with_exponents(value: Any) -> Any:
    """PyYAML leaves 1e-3 as text; rosparam does not."""
    if isinstance(value, dict):
        return {k: _with_exponents(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_with_exponents(v) for v in value]
    if isinstance(value, str) and "e" in value.lower() and value[:1] in "+-.0123456789":
        try:
            return float(value)
        except ValueError:
            return value
    return value
