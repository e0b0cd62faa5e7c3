"""The contract of smoothers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from navstack.core import Costmap, GridGeometry, InputError, Path
from navstack.plugins import Smoother
from navstack.testing.base import Contract, contract_of


class SmootherContract(Contract):
    """What every smoother must do."""

    @classmethod
    def make(cls, **values: Any) -> Smoother:
        """The smoother."""
        return cls.plugin(cls.params(**values))

    def costmap(self) -> Costmap:
        """10 x 10 m, free but for a block of inscribed cells in the lower right quarter."""
        costmap = Costmap(GridGeometry(200, 200, 0.05), np.zeros((200, 200), np.uint8))
        costmap.data[:100, 100:] = 253
        return costmap

    def corner(self) -> Path:
        """A path around the block, close to its corner."""
        along = [(x, 5.05, 0.0) for x in np.arange(2.0, 4.9, 0.1)] + [(4.95, 5.05, 0.0)]
        down = [(4.95, y, -math.pi / 2.0) for y in np.arange(4.95, 2.0, -0.1)]
        return Path(np.array(along + down))

    def test_ends_and_input_stay(self) -> None:
        """The ends are those of the path, which is unchanged, as is the costmap."""
        path, costmap = self.corner(), self.costmap()
        poses, data = path.poses.copy(), costmap.data.copy()
        out = self.make().smooth(path, costmap)
        assert (path.poses == poses).all() and (costmap.data == data).all()
        assert out.frame == path.frame
        assert np.abs(out.poses[[0, -1], :2] - poses[[0, -1], :2]).max() < 1e-9
        assert np.isfinite(out.poses).all()
        assert ((-math.pi < out.poses[:, 2]) & (out.poses[:, 2] <= math.pi)).all()

    def test_free_space_is_not_left(self) -> None:
        """No point of the result is in an inscribed or lethal cell."""
        costmap = self.costmap()
        out = self.make().smooth(self.corner(), costmap)
        assert all((costmap.cost_at(float(x), float(y)) or 0) < 253 for x, y in out.poses[:, :2])

    def test_short_and_wrong_paths(self) -> None:
        """Paths of few poses come back; InputError for poses that are not finite."""
        costmap = self.costmap()
        for n in range(4):
            assert len(self.make().smooth(Path(self.corner().poses[:n]), costmap)) == n
        with pytest.raises(InputError, match="not finite"):
            self.make().smooth(Path(np.full((9, 3), math.nan)), costmap)

    def test_it_is_reproducible(self) -> None:
        """The same input gives the same bytes."""
        smoother, path, costmap = self.make(), self.corner(), self.costmap()
        first = smoother.smooth(path, costmap).poses.tobytes()
        assert smoother.smooth(path, costmap).poses.tobytes() == first
        assert self.make().smooth(path, costmap).poses.tobytes() == first


def smoother_contract(plugin: type[Smoother], **values: Any) -> type[SmootherContract]:
    """The suite for a smoother."""
    return contract_of(SmootherContract, plugin, values)
