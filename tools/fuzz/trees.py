"""Mutations of behavior trees: elements, ports, scripts, subtrees that call themselves, nesting, entities, includes."""

from __future__ import annotations

import copy
import random
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Final

from navstack.behavior_trees import NODES, BehaviorTree, BehaviorTreeRunError, StampedPose
from tools.fuzz.text import mutated_text
from tools.fuzz.values import hostile_text

VALID: Final = (
    """<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><RecoveryNode number_of_retries="6">
<PipelineSequence name="drive"><ControllerSelector selected_controller="{c}" default_controller="FollowPath"/>
<RateController hz="1.0"><Fallback><ReactiveSequence><Inverter><GlobalUpdatedGoal/></Inverter>
<IsGoalNearby path="{path}" proximity_threshold="4.0"/><ValidatePath path="{path}"/></ReactiveSequence>
<ComputePathToPose goal="{goal}" path="{path}" error_code_id="{code}"/></Fallback></RateController>
<FollowPath path="{path}" controller_id="{c}" error_code_id="{follow_code}"/></PipelineSequence>
<ReactiveFallback><GoalUpdated/><RoundRobin wrap_around="true"><Sequence><ClearEntireCostmap service_name="local_costmap"/>
</Sequence><Spin spin_dist="1.57"/><Wait wait_duration="5.0"/><BackUp backup_dist="0.3"/></RoundRobin></ReactiveFallback>
</RecoveryNode></BehaviorTree></root>""",
    """<root BTCPP_format="4" main_tree_to_execute="A"><BehaviorTree ID="A"><Sequence _skipIf="n > 3 &amp;&amp; !(x == 2)">
<Script code="n := 1; x := n * 2.5 + 1; s := 'a' .. 'b'"/><SubTree ID="B" key="{n}" _autoremap="true"/>
<Repeat num_cycles="3"><AlwaysSuccess _onSuccess="n += 1"/></Repeat>
<Switch2 variable="{s}" case_1="ab" case_2="2">
<AlwaysSuccess/><AlwaysFailure/><ForceSuccess><AlwaysFailure/></ForceSuccess></Switch2>
<Parallel success_count="1"><Sleep msec="20"/>
<Delay delay_msec="10"><AlwaysSuccess/></Delay></Parallel></Sequence></BehaviorTree><BehaviorTree ID="B"><Timeout msec="100">
<SetBlackboard value="4" output_key="key"/></Timeout></BehaviorTree></root>""",
    """<root main_tree_to_execute="A"><BehaviorTree ID="A"><SequenceStar><SubTreePlus ID="B" __autoremap="true" p="{goal}"/>
<SubTree ID="B" p="goal"/><RetryUntilSuccessful num_attempts="2"><IfThenElse><AlwaysFailure/><AlwaysSuccess/><AlwaysFailure/>
</IfThenElse></RetryUntilSuccessful></SequenceStar></BehaviorTree><BehaviorTree ID="B"><GoalReached goal="{p}"/></BehaviorTree>
</root>""",
)
_SCRIPTS: Final = (
    "n := 1", "a = 1", "1 +", "n += 'x'", "(" * 200, "x := 1 / 0", "~1.5", "'open", "a ? b : c", "n := 1e308 * 10",
    "-" * 500 + "1", "n == 1 ; ; m := n", "@g := 2", "s := s .. s", "1 < 2 < 3", "true", "", "__import__('os')",
)  # fmt: skip
_VALUES: Final = (
    "{goal}", "{path}", "{=}", "{@x}", "{}", "{ }", "-1", "0", "1e309", "nan", "2147483648", "99999999999999999999", "true",
    "1;2;3", "0;map;1;2;0;0;0;0;1", "{a}{b}", "{n", "SUCCESS", "B", "A", "self.xml", "../pipe", "/dev/zero",
)  # fmt: skip
_PROLOGS: Final = (
    '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>',
    '<!DOCTYPE r SYSTEM "file:///dev/zero">',
    '<?xml version="1.0" encoding="x-unknown"?>',
    '<?xml version="1.0" encoding="utf-16"?>',
)
_KEYS: Final = (
    "name",
    "ID",
    "path",
    "_skipIf",
    "_while",
    "_onHalted",
    "_autoremap",
    "goal",
    "num_cycles",
    "hz",
    "code",
    "if",
)


def mutated_tree(rng: random.Random) -> bytes:
    """Return a behavior tree with seeded changes."""
    source = rng.choice(VALID)
    chance = rng.random()
    if chance < 0.3:
        return mutated_text(source.encode(), rng)
    if chance < 0.34:
        return rng.choice(_PROLOGS).encode() + source.encode()
    if chance < 0.37:
        return _large(rng).encode()
    root = ET.fromstring(source)
    for _ in range(rng.choice((1, 1, 2, 4))):
        _change(root, rng)
    text = ET.tostring(root, encoding="unicode").replace("\0", "\x01").encode("utf-8", "replace")
    return mutated_text(text, rng) if chance > 0.95 else text


def _large(rng: random.Random) -> str:
    count = rng.choice((5, 60, 190, 260, 3000))
    name = rng.choice(("Inverter", "Sequence", "RetryUntilSuccessful", "Repeat"))
    ports = {"RetryUntilSuccessful": ' num_attempts="-1"', "Repeat": ' num_cycles="-1"'}.get(name, "")
    inner = f"<{name}{ports}>" * count + rng.choice(("<AlwaysSuccess/>", "<AlwaysFailure/>")) + f"</{name}>" * count
    match rng.randrange(3):
        case 0:
            return f'<root BTCPP_format="4"><BehaviorTree ID="A">{inner}</BehaviorTree></root>'
        case 1:
            leaves = "<AlwaysSuccess/>" * count
            return f'<root BTCPP_format="4"><BehaviorTree ID="A"><Sequence>{leaves}</Sequence></BehaviorTree></root>'
        case _:  # each tree calls the next one several times
            levels, width = rng.choice(((4, 3), (12, 8), (30, 2)))
            trees = [
                f'<BehaviorTree ID="T{i}"><Sequence>{f"""<SubTree ID="T{i + 1}"/>""" * width}</Sequence></BehaviorTree>'
                for i in range(levels)
            ]
            last = f'<BehaviorTree ID="T{levels}"><AlwaysSuccess/></BehaviorTree>'
            return f'<root BTCPP_format="4" main_tree_to_execute="T0">{"".join(trees)}{last}</root>'


def _change(root: ET.Element, rng: random.Random) -> None:
    elements = list(root.iter())
    element, other = rng.choice(elements), rng.choice(elements)
    tags = [name for name, _ in NODES.names()]
    match rng.randrange(8):
        case 0:
            element.tag = rng.choice(
                (rng.choice(tags), rng.choice(tags), "SubTree", "Action", "x", "BehaviorTree", "include")
            )
        case 1 | 2 | 3:
            key = rng.choice([*element.keys(), rng.choice(_KEYS)])
            texts = (rng.choice(_SCRIPTS), rng.choice(_VALUES), rng.choice(_VALUES), hostile_text(rng)[:2000])
            element.set(key, rng.choice(texts))
        case 4:
            if element.keys():
                del element.attrib[rng.choice(list(element.keys()))]
        case 5:
            if element not in list(other.iter()):
                element.append(
                    copy.deepcopy(other) if other not in list(element.iter()) else ET.Element(rng.choice(tags))
                )
        case 6:
            if len(element):
                del element[rng.randrange(len(element))]
        case _:
            ET.SubElement(root, "include", {"path": rng.choice(_VALUES)})


def read_tree(path: Path) -> None:
    """Read a tree, tick it for a while with a robot without servers, explain it."""
    tree = BehaviorTree(path, blackboard={"goal": StampedPose(1.0, 2.0), "n": 0, "x": 1})
    for tick in range(20):
        try:
            tree.tick(0.01 * tick)
        finally:
            if tick % 7 == 6:
                tree.halt()
    if not tree.explain():
        raise BehaviorTreeRunError("no explanation")
