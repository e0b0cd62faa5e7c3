"""A learned policy as a local planner: a neural network in ONNX commands the velocities, within limits and a collision check.

The network sees what `navstack/LocalControl-v0` (`navstack.gym`) shows: ranges, the goal, the velocity, and if wanted points of
the plan and the last action. The ranges are those of rays in the local costmap, so that the policy sees what every sensor has
marked, in logs and on robots as in simulation. It commands; this controller limits the speed, looks along the arc of the command,
slows down or turns where that collides, and turns to the goal's heading at its position.
"""
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
# numba infers the types of the kernel's arguments

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    LETHAL,
    ControlError,
    InputError,
    NoValidControlError,
    Path,
    Twist2D,
    angle_between,
    kernel,
    require,
    shortened,
)
from navstack.local_planner.path_follower import (
    Following,
    PathFollower,
    PathFollowerParams,
    check_speed,
    limited_turning_speed,
)
from navstack.local_planner.regulated_pure_pursuit import ArcCheck, Scene
from navstack.plugins import LOCAL_PLANNERS, CheckContext, Issue, LocalPlan, VelocityLimits, param

PLAN_SPACING_M: Final = 0.5
PLAN_RANGE_M: Final = 5.0
SLOWER: Final = (1.0, 0.5, 0.25)
"""Shares of a command that are tried until its arc is free; then the robot turns in place as the command does."""
LEAST_TURN: Final = 0.2
"""Least share of the turning speed of that turn."""


class PolicyParams(PathFollowerParams):
    """Parameters of a learned policy: its file, what it saw in training, and the limits of its commands."""

    model: str = param(
        "", "ONNX file: input (1, n) float32, the observation; output (1, 2) or (1, 3), the action in [-1, 1]"
    )
    beams: int = param(120, "rays of the observation", ge=1, le=10_000)
    fov: float = param(4.71238, "angle from the first to the last ray", unit="rad", gt=0.0, le=6.283185307179587)
    scan_x: float = param(0.055, "origin of the rays ahead of the robot's center: the lidar's", unit="m")
    scan_y: float = param(0.0, "origin of the rays to the left of it", unit="m")
    scan_yaw: float = param(0.0, "direction of the middle of the rays", unit="rad")
    scan_clip: float = param(4.0, "length of the rays; what is farther counts as free", unit="m", gt=0.0)
    goal_range: float = param(10.0, "larger distances of the goal count as this one", unit="m", gt=0.0)
    plan_points: int = param(0, "points of the plan in the observation, 0.5 m apart", ge=0, le=1000)
    last_action: bool = param(False, "the observation repeats the last action")
    max_vel_x: float = param(1.0, "speed of the action 1", unit="m/s", gt=0.0)
    min_vel_x: float = param(0.0, "speed of the action -1; 0 or less", unit="m/s", le=0.0)
    max_vel_y: float = param(
        0.0, "sideways speed of the action 1; 0: the policy has no such action", unit="m/s", ge=0.0
    )
    min_vel_y: float = param(0.0, "sideways speed of the action -1; 0 or less", unit="m/s", le=0.0)
    max_vel_theta: float = param(2.0, "turning speed of the action 1", unit="rad/s", gt=0.0)
    acc_lim_x: float = param(3.0, "acceleration of the base, for recovery behaviors", unit="m/s²", gt=0.0)
    acc_lim_y: float = param(0.0, "sideways acceleration of the base, likewise", unit="m/s²", ge=0.0)
    acc_lim_theta: float = param(6.0, "turning acceleration, also of the turn at the goal", unit="rad/s²", gt=0.0)
    use_collision_detection: bool = param(True, "look along the arc of a command before it is given")
    collision_time: float = param(0.6, "duration of that look", unit="s", gt=0.0)

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield what is wrong with the file, and what the policy cannot see."""
        yield from super().check(context)
        try:
            Model(self)
        except InputError as error:
            yield Issue("error", "policy-model", ("model",), error.message)
        costmap = context.local_costmap
        half = min(costmap.width, costmap.height) / 2.0
        if costmap.rolling_window and self.scan_clip > half + 1e-9:
            message = (
                f"the policy saw {self.scan_clip:g} m far (scan_clip), but the local costmap ends {half:g} m from the robot, and "
                f"what is beyond looks free; set its width and height to {2.0 * self.scan_clip:g} m"
            )
            yield Issue("warning", "window-too-small", ("/local_costmap/width", "/local_costmap/height"), message)

    @property
    def action_size(self) -> int:
        """Numbers of an action."""
        return 3 if self.max_vel_y > 0.0 else 2

    @property
    def observation_size(self) -> int:
        """Numbers of an observation."""
        return self.beams + 6 + 2 * self.plan_points + (self.action_size if self.last_action else 0)

    @property
    def ray_angles(self) -> tuple[float, float]:
        """Direction of the first ray in the robot's frame, and the angle between two (rad), as of the simulated lidar."""
        if self.beams == 1:
            return self.scan_yaw, self.fov
        whole = self.fov > 2.0 * math.pi - 1e-6
        increment = self.fov / (self.beams if whole else self.beams - 1)
        return self.scan_yaw - 0.5 * increment * (self.beams - 1), increment


class Model:
    """A network from a file, on one thread: the same observation gives the same action."""

    def __init__(self, params: PolicyParams) -> None:
        """Read the file. Raises InputError for one that is absent, damaged or of other shapes."""
        if not params.model:
            raise InputError("no policy is given; set model to an ONNX file", model="")
        self.file = file = FilePath(params.model).expanduser()
        if not file.is_file():
            raise InputError(f"the policy {file} does not exist; set model to an ONNX file", model=str(file))
        runtime = require("onnxruntime", "a policy as the local planner")
        options = runtime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.use_deterministic_compute = True
        options.log_severity_level = 4
        try:
            self._session: Any = runtime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
        except Exception as exc:  # onnxruntime has a class of its own per cause
            reason = shortened(" ".join(str(exc).split()), 160)
            raise InputError(
                f"{file} is not a readable ONNX file ({reason}); export the policy again", model=str(file)
            ) from None
        self._check(params.observation_size, params.action_size)

    def _check(self, observations: int, actions: int) -> None:
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        if len(inputs) != 1:
            names = ", ".join(i.name for i in inputs)
            raise InputError(
                f"{self.file} has {len(inputs)} inputs ({names}); export a policy with one, the flat observation",
                model=str(self.file),
            )
        shape, kind = list(inputs[0].shape), inputs[0].type
        wanted = f"(1, {observations}) float32"
        if len(shape) != 2 or kind != "tensor(float)" or (isinstance(shape[1], int) and shape[1] != observations):
            raise InputError(
                f"the input of {self.file} is {_shape_text(shape)} {kind}, but beams, plan_points and last_action make an "
                f"observation of {wanted}; set them as in training",
                model=str(self.file),
                shape=[str(n) for n in shape],
            )
        self._input = inputs[0].name
        self._output = outputs[0].name
        try:
            found = self(np.zeros(observations, np.float32))
        except ControlError as exc:
            raise InputError(exc.message, model=str(self.file)) from None
        if found.size != actions:
            raise InputError(
                f"the output of {self.file} has {found.size} numbers, but an action has {actions} (3 with max_vel_y above 0, "
                "else 2); export the policy's action, or set max_vel_y",
                model=str(self.file),
                shape=list(found.shape),
            )

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the action (a,) of an observation (n,), clipped to [-1, 1]. Raises ControlError if it is not finite."""
        try:
            raw = self._session.run([self._output], {self._input: observation[None]})[0]
        except Exception as exc:  # as above: an input of another size inside, for example
            reason = shortened(" ".join(str(exc).split()), 160)
            raise ControlError(
                f"{self.file} cannot be run on an observation of {observation.size} numbers: {reason}"
            ) from None
        action = np.asarray(raw, np.float64).reshape(-1)
        if not np.isfinite(action).all():
            raise ControlError(
                f"the policy {self.file.name} gave the action {action.tolist()}, which is not finite; train or export it again",
                action=[str(v) for v in action.tolist()],
            )
        return np.clip(action, -1.0, 1.0)


def _shape_text(shape: list[Any]) -> str:
    return f"({', '.join(str(n) if n is not None else '?' for n in shape)})"


@kernel
def costmap_ranges(costs, grid, eye, first_angle, increment, reach, out):
    """Write the distances (m) along rays to the first lethal cell of a costmap to `out` (n,); `reach` without one.

    `grid` (3,): origin x, y and resolution; `eye` (3,): origin of the rays and the direction that angles count from.
    """
    ny, nx = costs.shape
    x, y = (eye[0] - grid[0]) / grid[2], (eye[1] - grid[1]) / grid[2]
    longest = reach / grid[2]
    for i in range(out.shape[0]):
        angle = eye[2] + first_angle + i * increment
        dx, dy = math.cos(angle), math.sin(angle)
        ix, iy = math.floor(x), math.floor(y)
        # distances (cells) to the next borders (Amanatides and Woo, 1987)
        per_x = abs(1.0 / dx) if dx != 0.0 else math.inf
        per_y = abs(1.0 / dy) if dy != 0.0 else math.inf
        to_x = (ix + 1.0 - x if dx > 0.0 else x - ix) * per_x if dx != 0.0 else math.inf
        to_y = (iy + 1.0 - y if dy > 0.0 else y - iy) * per_y if dy != 0.0 else math.inf
        passed = 0.0
        while passed < longest and 0 <= ix < nx and 0 <= iy < ny and costs[iy, ix] != LETHAL:
            if to_x < to_y:
                passed = to_x
                to_x += per_x
                ix += 1 if dx > 0.0 else -1
            else:
                passed = to_y
                to_y += per_y
                iy += 1 if dy > 0.0 else -1
        inside = 0 <= ix < nx and 0 <= iy < ny
        out[i] = passed * grid[2] if passed < longest and inside else reach


@LOCAL_PLANNERS.register("policy")
class PolicyController(PathFollower):
    """A learned policy from an ONNX file."""

    Params = PolicyParams
    params: PolicyParams  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, params: PolicyParams) -> None:
        """Read the model. Raises InputError."""
        super().__init__(params)
        self._model = Model(params)
        self._check_arc = ArcCheck()
        self._ranges = np.empty(params.beams)
        self._last_action = np.zeros(params.action_size)
        self._v_max = math.hypot(max(params.max_vel_x, -params.min_vel_x), params.max_vel_y)
        self._w_max = params.max_vel_theta
        self._last_turn = 0.0

    @property
    def limits(self) -> VelocityLimits:
        """The scale of the actions, and the limits of `set_limits`."""
        p, v = self.params, self._v_max
        return VelocityLimits(
            max_vel_x=min(p.max_vel_x, v),
            min_vel_x=max(p.min_vel_x, -v),
            max_vel_y=min(p.max_vel_y, v),
            min_vel_y=max(p.min_vel_y, -v),
            max_vel_trans=v,
            min_vel_trans=0.0,
            max_vel_theta=self._w_max,
            min_vel_theta=0.0,
            acc_lim_x=p.acc_lim_x,
            acc_lim_y=p.acc_lim_y,
            acc_lim_theta=p.acc_lim_theta,
            yaw_goal_tolerance=self.goal_checker.yaw_tolerance,
        )

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lower the speed limits (m/s, rad/s) until the next call; None restores the parameter's value."""
        check_speed(max_vel_trans=max_vel_trans, max_vel_theta=max_vel_theta)
        p = self.params
        fastest = math.hypot(max(p.max_vel_x, -p.min_vel_x), p.max_vel_y)
        self._v_max = fastest if max_vel_trans is None else min(fastest, max_vel_trans)
        self._w_max = p.max_vel_theta if max_vel_theta is None else min(p.max_vel_theta, max_vel_theta)

    def reset(self) -> None:
        """Reset the previous goal and the last action."""
        super().reset()
        self._last_action[:] = 0.0
        self._last_turn = 0.0

    def arrived(self) -> None:
        """Start the next goal from rest."""
        self._last_action[:] = 0.0
        self._last_turn = 0.0

    def take_over(self, velocity: Twist2D) -> None:
        """Turn on from there."""
        self.arrived()
        self._last_turn = velocity.wz

    def follow(self, now: Following) -> LocalPlan:
        """Command what the policy wants, as far as the way is free.

        Raises NoValidControlError if every arc collides, ControlError for an action that is not finite.
        """
        local_plan = Path(now.path.poses, now.costmap.frame)
        if now.at_position:
            error = angle_between(now.state.pose.yaw, now.goal.yaw)
            p = self.params
            w = limited_turning_speed(error, self._w_max, p.acc_lim_theta, self._last_turn, self.period)
            wanted, mode = Twist2D(0.0, 0.0, min(max(w, -self._w_max), self._w_max)), "rotate_to_goal"
            notes = [f"at the goal's position: turns by {math.degrees(error):.0f}°"]
        else:
            action = self._model(self.observation(now))
            wanted, mode = self._limited(action), "follow"
            notes = [f"action of the policy: {', '.join(f'{v:.3f}' for v in action.tolist())}"]
            self._last_action[:] = action
        command, trajectory = self._checked(now, wanted, notes)
        self._last_turn = command.wz
        return LocalPlan(command, mode, trajectory=trajectory, local_plan=local_plan, notes=tuple(notes))

    def observation(self, now: Following) -> NDArray[np.float32]:
        """Return the observation (n,) of a cycle, in the order of `navstack/LocalControl-v0`."""
        p, state = self.params, now.state
        pose, geometry = state.pose, now.costmap.geometry
        c, s = math.cos(pose.yaw), math.sin(pose.yaw)
        out = np.empty(p.observation_size, np.float32)
        eye = np.array([pose.x + c * p.scan_x - s * p.scan_y, pose.y + s * p.scan_x + c * p.scan_y, pose.yaw])
        grid = np.array([geometry.origin_x, geometry.origin_y, geometry.resolution])
        costmap_ranges(now.costmap.data, grid, eye, *p.ray_angles, p.scan_clip, self._ranges)
        at = p.beams
        out[:at] = np.minimum(self._ranges, p.scan_clip) / p.scan_clip
        dx, dy = now.goal.x - pose.x, now.goal.y - pose.y
        bearing = math.atan2(dy, dx) - pose.yaw
        distance = min(math.hypot(dx, dy), p.goal_range) / p.goal_range
        out[at : at + 3] = distance, math.cos(bearing), math.sin(bearing)
        scales = max(p.max_vel_x, -p.min_vel_x), p.max_vel_y, p.max_vel_theta
        out[at + 3 : at + 6] = [min(max(v / m, -1.0), 1.0) if m > 0.0 else 0.0 for v, m in zip(state.velocity, scales)]
        at += 6
        if p.plan_points:
            points = _points_ahead(now.path.poses, pose.x, pose.y, p.plan_points) - (pose.x, pose.y)
            turned = points @ np.array([[c, -s], [s, c]])
            out[at : at + 2 * p.plan_points] = np.clip(turned / PLAN_RANGE_M, -1.0, 1.0).ravel()
            at += 2 * p.plan_points
        out[at:] = self._last_action[: len(out) - at]
        return out

    def _limited(self, action: NDArray[np.float64]) -> Twist2D:
        """Return the velocity of an action, slower on the same arc where a limit is lower than in training."""
        p = self.params
        vx = p.min_vel_x + 0.5 * (float(action[0]) + 1.0) * (p.max_vel_x - p.min_vel_x)
        vy = p.min_vel_y + 0.5 * (float(action[1]) + 1.0) * (p.max_vel_y - p.min_vel_y) if p.max_vel_y > 0.0 else 0.0
        wz = float(action[-1]) * p.max_vel_theta
        speed = math.hypot(vx, vy)
        share = min(1.0, self._v_max / speed if speed > 0.0 else 1.0, self._w_max / abs(wz) if wz != 0.0 else 1.0)
        return Twist2D(share * vx, share * vy, share * wz)

    def _checked(self, now: Following, wanted: Twist2D, notes: list[str]) -> tuple[Twist2D, NDArray[np.float64] | None]:
        """Return the command, slower or a turn in place if the arc collides, and its arc; appends to `notes`."""
        p = self.params
        if not p.use_collision_detection:
            return wanted, None
        scene = Scene.of(now)
        turn = math.copysign(max(abs(wanted.wz), LEAST_TURN * self._w_max), wanted.wz)
        tried = [Twist2D(f * wanted.vx, f * wanted.vy, f * wanted.wz) for f in SLOWER]
        tried += [Twist2D(0.0, 0.0, turn), Twist2D(0.0, 0.0, -turn)] if wanted.speed > 0.0 else []
        for number, command in enumerate(tried):
            hit, poses = self._check_arc.first_collision(scene, command, p.collision_time, math.inf, as_nav2=False)
            if hit < 0:
                if number > 0:
                    notes.append(
                        f"the policy's ({wanted.vx:.2f} m/s, {wanted.wz:.2f} rad/s) collides within {p.collision_time:g} s: "
                        + ("turns in place" if command.speed == 0.0 else "slower on the same arc")
                    )
                return command, poses
        raise NoValidControlError(
            f"what the policy commands ({wanted.vx:.2f} m/s, {wanted.wz:.2f} rad/s) collides within {p.collision_time:g} s; "
            "slower, and when it turns in place, too",
            command=list(wanted),
            notes=notes,
        )


def _points_ahead(path: NDArray[np.float64], x: float, y: float, count: int) -> NDArray[np.float64]:
    """Return (count, 2) points of the path every 0.5 m from the one nearest to (x, y); the last one where it ends."""
    if not len(path):
        return np.tile([x, y], (count, 1))
    steps = np.hypot(*np.diff(path[:, :2], axis=0).T) if len(path) > 1 else np.empty(0)
    length = np.concatenate(([0.0], np.cumsum(steps)))
    nearest = int(np.argmin(np.hypot(path[:, 0] - x, path[:, 1] - y)))
    wanted = length[nearest] + PLAN_SPACING_M * np.arange(1, count + 1)
    return path[np.minimum(np.searchsorted(length, wanted - 1e-9), len(path) - 1), :2]
