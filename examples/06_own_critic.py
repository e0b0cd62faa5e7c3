"""A critic of your own for DWA: prefers commands that turn to the left."""

import numpy as np

import navstack as nav
from navstack.plugins import CRITICS, Critic, ParamModel, param


class LeftParams(ParamModel):
    """`DWAPlannerROS/left`."""

    scale: float = param(0.1, "weight in the sum", ge=0.0)


@CRITICS.register("left")
class Left(Critic[LeftParams]):
    """Scores the turning speed to the right (rad/s)."""

    Params = LeftParams

    scale = property(lambda self: self.params.scale)

    def score(self, rollouts) -> np.ndarray:
        """(K,) turning speed to the right."""
        return np.maximum(-rollouts.commands[:, 2], 0.0)


critics = ["oscillation", "obstacle", "goal_front", "alignment", "path", "goal", "left"]
print(nav.simulate("office", robot=nav.load_robot(DWAPlannerROS={"critics": critics}), goals=["kitchen"]))
