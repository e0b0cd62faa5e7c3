"""Mutations of launch files: elements, attributes, substitutions, nesting, entities, files that include themselves."""

from __future__ import annotations

import copy
import random
import xml.etree.ElementTree as ET
from functools import cache
from typing import Final

from tools.fuzz.text import mutated_text, mutated_yaml
from tools.fuzz.values import TEXTS, hostile_text

_TAGS: Final = (
    "launch",
    "group",
    "arg",
    "include",
    "node",
    "param",
    "rosparam",
    "remap",
    "machine",
    "env",
    "test",
    "x",
)
_SUBSTITUTIONS: Final = (
    *(
        "$(arg f)",
        "$(arg f)$(arg f)",
        "$(arg missing)",
        "$(arg $(arg f))",
        "$(find)",
        "$(find x)",
        "$(find ../../..)/pipe",
    ),
    *("$(eval 1+1)", "$(eval __import__('os'))", "$(env PATH)", "$(env)", "$(optenv A b c)", "$(dirname)/self.launch"),
    *(
        "$(anon x)",
        "$(",
        "$(arg",
        "$(arg f))",
        "$$(arg f)",
        "$(find x)/../pipe",
        "$(find x)/" + "a/" * 60,
        "$(dirname)",
    ),
)
_ATTRIBUTES: Final = (
    "file",
    "name",
    "value",
    "default",
    "ns",
    "if",
    "unless",
    "command",
    "param",
    "type",
    "pkg",
    "from",
)
_ENTITIES: Final = (
    '<!DOCTYPE l [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>',
    '<!DOCTYPE l SYSTEM "file:///dev/zero">',
    '<!DOCTYPE l [<!ENTITY x SYSTEM "pipe">]>',
    '<?xml version="1.0" encoding="utf-16"?>',
    '<?xml version="1.1" encoding="x-unknown"?>',
    '<?xml version="1.0" standalone="yes"?>',
    "<?xml-stylesheet href='pipe'?>",
    "<!-- " + "-" * 50 + " -->",
)


@cache
def _tree(data: bytes) -> ET.Element:
    return ET.fromstring(data)


def mutated_launch(data: bytes, rng: random.Random) -> bytes:
    """Change the text or the elements of a launch file that is valid before."""
    chance = rng.random()
    if chance < 0.35:
        return mutated_text(data, rng)
    if chance < 0.38:
        return _expanding(rng)
    if chance < 0.42:
        depth = rng.choice((5, 90, 101, 5000))
        return b"<launch>" + b"<group>" * depth + b'<param name="a" value="1"/>' + b"</group>" * depth + b"</launch>"
    if chance < 0.47:
        return rng.choice(_ENTITIES).encode() + data
    root = copy.deepcopy(_tree(data))
    for _ in range(rng.choice((1, 1, 2, 4))):
        _change(root, rng)
    text = ET.tostring(root, encoding="unicode").replace("\0", "\x01")
    out = text.encode("utf-8", "replace")
    return mutated_text(out, rng) if chance > 0.93 else out


def _change(root: ET.Element, rng: random.Random) -> None:
    elements = list(root.iter())
    element, other = rng.choice(elements), rng.choice(elements)
    match rng.randrange(8):
        case 0:
            element.tag = rng.choice(_TAGS)
        case 1 | 2 | 3:
            key = rng.choice([*element.keys(), rng.choice(_ATTRIBUTES)])
            element.set(key, rng.choice(_SUBSTITUTIONS) if rng.random() < 0.5 else hostile_text(rng)[:3000])
        case 4:
            if element.keys():
                del element.attrib[rng.choice(element.keys())]
        case 5:
            if element not in list(other.iter()):
                element.append(copy.deepcopy(other) if other not in list(element.iter()) else ET.Element("group"))
        case 6:
            if element.text and element.text.strip():
                try:
                    element.text = mutated_yaml(element.text.encode("utf-8", "replace"), rng).decode("utf-8", "replace")
                except Exception:  # the text is no YAML: an earlier change has broken it
                    element.text = rng.choice(TEXTS)
            else:
                element.text = rng.choice(_SUBSTITUTIONS)
        case _:
            if len(element):
                del element[rng.randrange(len(element))]


def _expanding(rng: random.Random) -> bytes:
    """Arguments that each repeat the one before, so that a short file states a text of gigabytes."""
    levels, width = rng.choice(((5, 3), (12, 8), (30, 2), (9, 10), (60, 4)))
    lines = ['<arg name="a0" value="xxxxxxxxxx"/>']
    lines += [f'<arg name="a{i}" value="{f"$(arg a{i - 1})" * width}"/>' for i in range(1, levels)]
    used = rng.choice(
        (
            f'<param name="a" value="$(arg a{levels - 1})"/>',
            f'<rosparam subst_value="true">a: $(arg a{levels - 1})</rosparam>',
            f'<include file="$(arg a{levels - 1})"/>',
            f'<group ns="$(arg a{levels - 1})"/>',
        )
    )
    node = f'<node pkg="move_base" type="move_base" name="move_base">{used}</node>'
    return f"<launch>{''.join(lines)}{node}</launch>".encode()
