"""One clear error with file, line and column for each fault of a file, and none that hangs."""

from __future__ import annotations

from pathlib import Path

import pytest

from navstack.behavior_trees import BehaviorTree, BehaviorTreeError, BehaviorTreeRunError, StampedPose, Status


def tree(inner: str, more: str = "", root: str = 'BTCPP_format="4" main_tree_to_execute="A"') -> str:
    return f'<root {root}>\n  <BehaviorTree ID="A">\n    {inner}\n  </BehaviorTree>\n{more}</root>'


FAULTS = {
    "unknown node": (tree("<Sequens><AlwaysSuccess/></Sequens>"), 3, 5, 'did you mean "Sequence"?'),
    "unknown node by ID": (tree('<Action ID="Spinn"/>'), 3, 5, 'did you mean "Spin"?'),
    "tree as a node": (tree("<B/>", '<BehaviorTree ID="B"><AlwaysSuccess/></BehaviorTree>'), 3, 5, '<SubTree ID="B"/>'),
    "unknown port": (tree('<Spin spin_dst="1"/>'), 3, 11, 'did you mean "spin_dist"?'),
    "misspelt condition": (tree('<AlwaysSuccess _skipif="true"/>'), 3, 20, 'did you mean "_skipIf"?'),
    "wrong type": (tree('<Spin spin_dist="far"/>'), 3, 11, "write a number"),
    "wrong bool": (tree('<Spin is_recovery="maybe"/>'), 3, 11, "write true or false"),
    "missing port": (tree('<Repeat><AlwaysSuccess/></Repeat>'), 3, 5, 'write num_cycles=".."'),
    "missing path": (tree("<FollowPath/>"), 3, 5, 'write path="{path}"'),
    "pose as text": (tree('<GoalReached goal="1,2"/>'), 3, 18, "stamp_ns;frame"),
    "two types of an entry": (
        tree('<Sequence><GoalReached goal="{x}"/>\n<FollowPath path="{x}"/></Sequence>'), 4, 13, "of type pose in another port"
    ),
    "script": (tree('<Script code="1 +"/>'), None, None, "an operand is missing"),
    "condition": (tree('<AlwaysSuccess _skipIf="a ? b"/>'), 3, 20, '":" is missing'),
    "no child": (tree("<Inverter/>"), 3, 5, "exactly 1 child, not 0"),
    "three children": (tree("<RecoveryNode><AlwaysSuccess/></RecoveryNode>"), 3, 5, "exactly 2 children, not 1"),
    "a leaf with a child": (tree("<Spin><Spin/></Spin>"), 3, 5, "no children, not 1"),
    "subtree of itself": (tree('<SubTree ID="A"/>'), 3, 14, "A -> A"),
    "subtree in a circle": (
        tree('<SubTree ID="B"/>', '<BehaviorTree ID="B"><Inverter><SubTree ID="A"/></Inverter></BehaviorTree>'),
        5,
        41,
        "A -> B -> A",
    ),
    "no such subtree": (
        tree('<SubTree ID="Dok"/>', '<BehaviorTree ID="Dock"><AlwaysSuccess/></BehaviorTree>'), 3, 14, 'did you mean "Dock"?'
    ),
    "no such main tree": (tree("<AlwaysSuccess/>", root='BTCPP_format="4" main_tree_to_execute="a"'), 1, 24, 'did you mean "A"?'),
    "two trees": (
        tree("<AlwaysSuccess/>", '<BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree>'), 5, 15, "exists already at <text>:2:3"
    ),
    "format": (tree("<AlwaysSuccess/>", root='BTCPP_format="5"'), 1, 7, "formats 3 and 4"),
    "not a tree": ("<launch/>", 1, 1, "a behavior tree begins with <root"),
    "no tree": ('<root BTCPP_format="4"/>', 1, 1, "add one"),
    "not XML": ('<root BTCPP_format="4">\n<BehaviorTree>', 2, 15, "ends too early"),
    "empty": ("<", 1, 1, "not valid XML"),
    "entity": ('<!DOCTYPE r [\n<!ENTITY a "x">]><root>&a;</root>', 2, 12, 'the entity "a" is declared'),
    "include": ('<root>\n<include path="gone.xml"/></root>', 2, 10, "does not exist"),
    "include of a package": ('<root><include ros_pkg="p" path="a.xml"/></root>', 1, 16, "packages={..}"),
    "deep": (tree("<Inverter>" * 250 + "<AlwaysSuccess/>" + "</Inverter>" * 250), 3, None, "flatten the tree"),
    "deep XML": (tree("<Inverter>" * 400 + "<AlwaysSuccess/>" + "</Inverter>" * 400), 3, None, "nested more than 256 deep"),
    "speed": (tree('<SpeedController min_rate="0"><AlwaysSuccess/></SpeedController>'), None, None, "set both above 0"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_located_error(fault: str) -> None:
    text, line, column, fix = FAULTS[fault]
    kind = BehaviorTreeError if line is not None else BehaviorTreeRunError
    with pytest.raises(kind) as caught:
        BehaviorTree(text)
    assert fix in caught.value.message
    assert "<text>:" in caught.value.message
    if line is not None:
        assert caught.value.data["line"] == line
    if column is not None:
        assert caught.value.data["column"] == column


def test_files_that_include_each_other_are_an_error(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text('<root><include path="b.xml"/></root>')
    (tmp_path / "b.xml").write_text('<root>\n <include path="a.xml"/></root>')
    with pytest.raises(BehaviorTreeError, match=r"b\.xml:2:11: a\.xml includes itself"):
        BehaviorTree(tmp_path / "a.xml")


def test_an_included_tree_is_called(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    part = '<root BTCPP_format="4"><BehaviorTree ID="B"><AlwaysFailure/></BehaviorTree></root>'
    (tmp_path / "parts" / "b.xml").write_text(part)
    (tmp_path / "a.xml").write_text(tree('<SubTree ID="B"/>', '<include path="parts/b.xml"/>'))
    assert BehaviorTree(tmp_path / "a.xml").tick(0.0) is Status.FAILURE


def test_a_missing_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(BehaviorTreeError, match="cannot be read"):
        BehaviorTree(tmp_path / "gone.xml")


@pytest.mark.slow
def test_ten_thousand_nodes_are_read_and_ticked() -> None:
    found = BehaviorTree(tree("<Sequence>" + "<AlwaysSuccess/>" * 10_000 + "</Sequence>"))
    assert len(found.nodes) == 10_001
    assert found.tick(0.0) is Status.SUCCESS


@pytest.mark.slow
def test_subtrees_that_multiply_are_bounded() -> None:
    more = "".join(
        f'<BehaviorTree ID="T{i}"><Sequence>{f"""<SubTree ID="T{i + 1}"/>""" * 10}</Sequence></BehaviorTree>'
        for i in range(12)
    )
    text = tree('<SubTree ID="T0"/>', more + '<BehaviorTree ID="T12"><AlwaysSuccess/></BehaviorTree>')
    with pytest.raises(BehaviorTreeError, match="more than 30000 nodes"):
        BehaviorTree(text)


@pytest.mark.parametrize(
    "endless",
    [
        '<Repeat num_cycles="-1"><AlwaysSuccess/></Repeat>',
        '<RetryUntilSuccessful num_attempts="-1"><AlwaysFailure/></RetryUntilSuccessful>',
        '<RecoveryNode number_of_retries="2000000000"><AlwaysFailure/><AlwaysSuccess/></RecoveryNode>',
    ],
)
@pytest.mark.slow
def test_a_loop_without_end_is_an_error(endless: str) -> None:
    for root in ('BTCPP_format="4"', ""):
        with pytest.raises(BehaviorTreeRunError, match="limit the repetitions"):
            BehaviorTree(tree(endless, root=root)).tick(0.0)


def test_an_entry_of_another_type_is_an_error_of_the_node() -> None:
    found = BehaviorTree(tree('<Spin spin_dist="{angle}"/>'), blackboard={"angle": StampedPose(1.0, 2.0)})
    with pytest.raises(BehaviorTreeRunError, match='takes a value of type double, but the entry "angle"'):
        found.tick(0.0)


def test_an_unknown_distribution_is_an_error() -> None:
    with pytest.raises(BehaviorTreeError, match='did you mean "humble"'):
        BehaviorTree(tree("<AlwaysSuccess/>"), distro="humbel")
