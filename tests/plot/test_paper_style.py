"""Pictures for print: one column wide, small text, thin lines, vectors, no title."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from navstack.cli.app import run
from navstack.plot import paper_style, plot_run
from navstack.plot.canvas import PAPER_WIDTH_IN, Panels, is_paper, style
from navstack.record import Record

TITLE = "a title that no paper needs"


def texts_of(figure) -> list[str]:
    return [text.get_text() for text in figure.findobj(lambda part: hasattr(part, "get_text"))]


def test_a_pdf_is_one_column_wide_and_embeds_its_font(record: Record, tmp_path: Path) -> None:
    with paper_style():
        data = plot_run(record, tmp_path / "run.pdf").read_bytes()
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ", data)
    assert box is not None
    assert float(box[1]) == pytest.approx(72.0 * PAPER_WIDTH_IN, abs=0.01)
    assert b"/Type42" in data or b"/CIDFontType2" in data
    assert b"/Type3" not in data
    pages = b"".join(
        zlib.decompress(part) for part in re.findall(rb"/FlateDecode.*?stream\r?\n(.*?)endstream", data, re.S)[:1]
    )
    assert b" Tf" in pages and b" l\n" in pages  # text and lines, not a bitmap


@pytest.mark.slow
def test_the_width_is_that_of_a_column_in_every_format(record: Record, tmp_path: Path) -> None:
    with paper_style():
        svg = plot_run(record, tmp_path / "run.svg", title=TITLE).read_text()
        with Image.open(plot_run(record, tmp_path / "run.png")) as image:
            pixels = np.asarray(image.convert("RGB"))
    assert 'width="252pt"' in svg
    assert TITLE not in svg
    assert svg.count("<image") == 1  # the costmap
    assert svg.count("<path") > 100
    assert pixels.shape[1] == 300 * PAPER_WIDTH_IN
    assert (pixels[:5] == 255).all()  # no dark background
    assert TITLE in plot_run(record, tmp_path / "screen.svg", title=TITLE).read_text()


def test_panels_are_one_column_wide_with_the_legend_below(tmp_path: Path) -> None:
    with paper_style(), style():
        panels = Panels(tmp_path / "panels.png", None, ((3.0, 2.0), (0.55, 2.0)), title=TITLE)
        for axes in panels.axes:
            axes.plot([0.0, 1.0], [0.0, 1.0], label="speed")
        panels.legend()
        assert TITLE not in texts_of(panels.figure)
        assert panels.figure.get_figwidth() == PAPER_WIDTH_IN
        (legend,) = panels.figure.legends
        lowest = panels.axes[-1].get_tightbbox(panels.figure.canvas.get_renderer())
        assert legend.get_window_extent().y1 <= lowest.y0 + 1.0
        panels.finish(130.0)


def test_the_style_ends_with_the_command(record: Record, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    map_file = tmp_path / "office.png"
    assert run(["plot", "office", "--style", "paper", "--out", str(map_file)]) == 0
    assert not is_paper()
    with Image.open(map_file) as image:
        assert image.width == 300 * PAPER_WIDTH_IN
    assert run(["plot", "office", "--style", "papr", "--out", str(map_file)]) == 2
    assert '--style "papr": unknown style; choose screen or paper' in capfd.readouterr().err
