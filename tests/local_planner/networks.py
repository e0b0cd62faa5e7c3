"""Small networks in ONNX for tests of the policy controller."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper


def write_network(
    file: Path,
    weights: np.ndarray,
    bias: np.ndarray,
    *,
    shape: list[int | str] | None = None,
    kind: int = TensorProto.FLOAT,
) -> Path:
    """Write tanh(observation @ weights + bias)."""
    size = len(weights)
    element = np.float32 if kind == TensorProto.FLOAT else np.float64
    nodes = [
        helper.make_node("MatMul", ["observation", "weights"], ["product"]),
        helper.make_node("Add", ["product", "bias"], ["sum"]),
        helper.make_node("Tanh", ["sum"], ["action"]),
    ]
    graph = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info("observation", kind, shape or [1, size])],
        [helper.make_tensor_value_info("action", kind, None)],
        [
            numpy_helper.from_array(weights.astype(element), "weights"),
            numpy_helper.from_array(bias.astype(element), "bias"),
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 9
    onnx.save(model, str(file))
    return file


def toward_goal(file: Path, beams: int = 120, *, size: int | None = None, outputs: int = 2) -> Path:
    """Write a policy that drives towards its goal: faster the better it faces it, turning by the sine of the bearing."""
    weights = np.zeros((size or beams + 6, outputs))
    weights[beams + 1, 0], weights[beams + 2, -1] = 2.0, 3.0
    return write_network(file, weights, np.array([-0.5] + [0.0] * (outputs - 1)))


@cache
def _folder() -> TemporaryDirectory[str]:
    """A folder that exists until the process ends."""
    return TemporaryDirectory(prefix="navstack_policy_")


@cache
def shared_network() -> str:
    """The file of a policy with 120 beams that drives towards its goal."""
    return str(toward_goal(Path(_folder().name) / "policy.onnx"))
