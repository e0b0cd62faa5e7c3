"""Pose graphs: known optima, starts far from them, robust loops, files."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from navstack.core import InputError, LogError, Transform2D
from navstack.mapping import PoseGraph, read_g2o, solve, write_g2o
from navstack.mapping.pose_graph import Edge

SHARED = Path(__file__).parents[3] / "shared/data/carmen_raw"


def square(side: int = 10, laps: int = 2, seed: int = 0) -> tuple[PoseGraph, np.ndarray]:
    """Return the graph of a drive around a square with noisy steps and exact loops, and the true poses."""
    rng = np.random.default_rng(seed)
    truth = [Transform2D()]
    for n in range(4 * side * laps):
        turn = np.pi / 2.0 if n % side == side - 1 else 0.0
        truth.append(truth[-1] @ Transform2D(1.0, 0.0, turn))
    edges = []
    information = np.diag([100.0, 100.0, 400.0])
    for k in range(len(truth) - 1):
        step = truth[k].inverse() @ truth[k + 1]
        x, y, yaw = step
        noisy = Transform2D(x + rng.normal(0, 0.1), y + rng.normal(0, 0.1), yaw + rng.normal(0, 0.05))
        edges.append(Edge(k, k + 1, noisy, information))
    lap = 4 * side
    for k in range(0, len(truth) - lap, 5):
        edges += [Edge(k, k + lap, truth[k].inverse() @ truth[k + lap], information * 100.0, True)]
    graph = PoseGraph(np.zeros((len(truth), 3)), edges)
    return graph, np.array(truth)


@pytest.mark.parametrize(("name", "optimum"), [("CSAIL", 40.5551), ("MIT", 41.1633)])
def test_known_graphs_reach_their_stated_optimum(name: str, optimum: float) -> None:
    file = SHARED / f"{name}.g2o.gz"
    if not file.exists():
        pytest.skip("the shared pose graphs are not here")
    # the stated values have six digits
    assert solve(read_g2o(file), starts=("rotations",)).chi2 == pytest.approx(optimum, rel=2e-6)


def test_every_start_of_a_graph_ends_in_the_same_optimum() -> None:
    graph, truth = square()
    by_rotations, by_tree = (solve(graph, starts=(start,)) for start in ("rotations", "tree"))
    assert by_rotations.converged
    assert by_tree.chi2 == pytest.approx(by_rotations.chi2, rel=1e-6)
    # 80 steps of 0.1 m and 0.05 rad that each lap must close: the truth is met within the noise of a lap
    assert np.abs(by_rotations.poses[:, :2] - truth[:, :2]).max() < 3.0
    assert by_rotations.chi2 < graph.chi2(truth)


def test_the_solution_is_a_minimum_in_every_direction() -> None:
    graph, _ = square(side=4, laps=1)
    found = solve(graph)
    rng = np.random.default_rng(1)
    for _ in range(50):
        moved = found.poses + rng.normal(0.0, 1e-3, found.poses.shape)
        moved[0] = found.poses[0]
        assert graph.chi2(moved) > found.chi2


def test_the_kernel_keeps_a_wrong_loop_from_bending_the_graph() -> None:
    graph, _ = square()
    right = solve(graph).poses
    wrong = Edge(3, 27, Transform2D(0.0, 0.0, 0.0), np.diag([1e4, 1e4, 1e4]), True)
    graph.edges.append(wrong)
    graph.poses = right
    plain = solve(graph, starts=("poses",)).poses
    robust = solve(graph, starts=("poses",), kernel_width=3.0).poses
    assert np.abs(plain - right)[:, :2].max() > 1.0
    assert np.abs(robust - right)[:, :2].max() < 0.1


def test_a_written_graph_is_read_to_the_same_bits(tmp_path: Path) -> None:
    graph, _ = square(side=3)
    graph.poses = solve(graph).poses
    again = read_g2o(write_g2o(graph, tmp_path / "graph.g2o"))
    assert np.array_equal(again.poses, graph.poses)
    assert again.chi2() == graph.chi2()


def test_vertices_that_only_edges_name_are_placed(tmp_path: Path) -> None:
    file = tmp_path / "graph.g2o.gz"
    file.write_bytes(gzip.compress(b"EDGE_SE2 5 7 1 0 0 1 0 0 1 0 1\nEDGE_SE2 9 7 0 1 0 1 0 0 1 0 1\n"))
    graph = read_g2o(file)
    assert graph.ids == [5, 7, 9]
    assert graph.poses == pytest.approx(np.array([[0, 0, 0], [1, 0, 0], [1, -1, 0]]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n", "graph.g2o:1: VERTEX_SE3:QUAT is not supported"),
        ("VERTEX_SE2 0 0 0\n", "graph.g2o:1: VERTEX_SE2 must be followed by 4 numbers, not 3"),
        ("\nEDGE_SE2 0 1 nan 0 0 1 0 0 1 0 1\n", "graph.g2o:2: .* not a finite number"),
        ("EDGE_SE2 0 0 1 0 0 1 0 0 1 0 1\n", "the edge connects pose 0 with itself"),
        ("VERTEX_SE2 0 0 0 0\n", "has no EDGE_SE2 line"),
    ],
)
def test_defective_files_are_refused_with_their_line(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "graph.g2o"
    file.write_text(text)
    with pytest.raises(LogError, match=message):
        read_g2o(file)


def test_a_graph_in_pieces_is_refused() -> None:
    edges = [Edge(0, 1, Transform2D(1.0), np.eye(3)), Edge(2, 3, Transform2D(1.0), np.eye(3))]
    with pytest.raises(InputError, match="pose 2 and 1 others are not connected"):
        solve(PoseGraph(np.zeros((4, 3)), edges))
    with pytest.raises(InputError, match="nothing to solve"):
        solve(PoseGraph())
