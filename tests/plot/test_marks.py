"""Marks that share a place list their texts once, and not all of them."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure

from navstack.core import Pose2D
from navstack.plot import drawing


@pytest.mark.parametrize(
    ("texts", "label"), [(["2", "2", "1"], "2,1"), (["1", "2", "3", "4"], "1,2,3,4"), (list("112345"), "1,2,3,4...")]
)
def test_the_label_of_a_place(texts: list[str], label: str) -> None:
    axes = Figure().subplots()
    drawing.draw_marks(axes, [drawing.Mark(Pose2D(1.0, 2.0), text, "red") for text in texts], 20.0)
    assert [text.get_text() for text in axes.texts if text.get_text()] == [label]
