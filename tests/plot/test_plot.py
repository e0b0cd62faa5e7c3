from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from navstack.plot import plot_run
from tests.record import synthetic


@pytest.fixture(scope="session")
def record():
    return synthetic.record_run(24.0).record()


def test_the_picture_of_a_run_is_there_and_not_blank(record, tmp_path):
    path = plot_run(record, tmp_path / "run.png", dpi=80)
    with Image.open(path) as image:
        pixels = np.asarray(image.convert("RGB"))
    assert pixels.shape[1] > 600
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 50
