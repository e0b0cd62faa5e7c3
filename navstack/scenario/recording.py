"""What a run passes to its recorder."""

from __future__ import annotations

from pathlib import Path

from navstack.bringup import odometry_frame, true_footprint
from navstack.core import Transform2D
from navstack.move_base import MoveBase
from navstack.record import RunRecorder, SteeredBase
from navstack.record.solids import SolidNames
from navstack.record.ticks import record_tick_outputs
from navstack.scenario.scenario import Scenario
from navstack.sim import SimulatedRobot


def new_recorder(scenario: Scenario, robot: SimulatedRobot, *, scans: bool, spool: Path | None = None) -> RunRecorder:
    """Returns the recorder of a run of the scenario, with the obstacles if they do not move."""
    configuration = scenario.configuration
    sim = configuration.navstack.sim
    lidars = [sim.lidar(name) for name in sim.lasers]
    recorder = RunRecorder(
        map=scenario.map,
        footprint=true_footprint(configuration),
        scenario=scenario.as_dict(),
        global_frame=configuration.global_costmap.params.global_frame,
        local_frame=odometry_frame(configuration),
        base_frame=configuration.local_costmap.params.robot_base_frame,
        sensors={lidar.frame: Transform2D(lidar.x, lidar.y, lidar.yaw) for lidar in lidars},
        steering=SteeredBase.of(sim),
        keep_scans=scans,
        spool=spool,
    )
    solids = robot.solids
    if not robot.world.moves and scenario.shapes:
        recorder.solids(solids.discs, solids.corners, solids.first)
    return recorder


def record_tick(
    recorder: RunRecorder, robot: SimulatedRobot, move_base: MoveBase, goal: int, solids: SolidNames | None
) -> None:
    """Adds what the last tick did to the record; `solids` are the names of the obstacles once they have changed."""
    t = move_base.last_tick.time
    record_tick_outputs(recorder, move_base)
    if robot.world.moves or solids is not None:
        recorder.solids(robot.solids.discs, robot.solids.corners, robot.solids.first, solids)
    localizer = robot.estimation.localizer
    if localizer is not None:
        recorder.estimate(localizer)
    recorder.sample(
        t,
        pose=robot.pose,
        odom=robot.state(),
        map_to_odom=robot.frames.lookup(robot.map_frame, robot.odom_frame),
        command=move_base.command if robot.by_hand is None else robot.by_hand,
        state=move_base.activity,
        goal_index=goal,
        steering=robot.steering_angle,
    )
