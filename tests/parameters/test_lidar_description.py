"""The lidars of an unknown robot: from its URDF and xacro files, else assumed."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from navstack.parameters import Configuration, LidarParams, load_configuration
from navstack.parameters.lidar_description import lidars_of
from navstack.scenario.outcome import collision_advice

PLANNER = {"base_local_planner": "dwa_local_planner/DWAPlannerROS"}


def costmap(topics: dict[str, str], raytrace: float = 4.0) -> dict[str, Any]:
    sources = {
        name: {"topic": topic, "data_type": kind, "marking": True, "clearing": True, "raytrace_range": raytrace}
        for name, (topic, kind) in ((t.replace("/", "_"), (t, k)) for t, k in topics.items())
    }
    layer = {"observation_sources": " ".join(sources), **sources}
    plugins = [{"name": "obstacle_layer", "type": "costmap_2d::ObstacleLayer"}]
    return {"plugins": plugins, "obstacle_layer": layer, "rolling_window": True, "robot_radius": 0.2}


def robot(topics: dict[str, str], **more: Any) -> dict[str, Any]:
    return {"local_costmap": costmap(topics), "global_costmap": costmap(topics), **PLANNER, **more}


def lidars(configuration: Configuration) -> dict[str, LidarParams]:
    sim = configuration.navstack.sim
    return {name: sim.lidar(name) for name in sim.lasers}


def test_a_lidar_that_no_file_describes_is_assumed_wide_and_said_once() -> None:
    loaded = load_configuration([robot({"scan": "LaserScan"})])
    [lidar] = lidars(loaded).values()
    assert (lidar.fov, lidar.range_min, lidar.range_max) == (1.5 * math.pi, 0.05, 4.0)
    [found] = [f for f in loaded.findings if f.rule == "assumed-lidar"]
    assert "270 degrees, 0.05 to 4 m" in found.message
    # what is set is kept, and the packaged robots have their own
    own = load_configuration([robot({"scan": "LaserScan"}, navstack={"sim": {"laser": {"fov": 2.0}}})])
    assert [lidar.fov for lidar in lidars(own).values()] == [2.0]
    assert lidars(load_configuration(["turtlebot"]))["laser"].fov == 1.0


def test_a_base_that_nothing_describes_accelerates_as_the_trajectories_of_its_planner() -> None:
    rollout = {"base_local_planner": "base_local_planner/TrajectoryPlannerROS"}
    rollout |= {"TrajectoryPlannerROS": {"acc_lim_x": 1.25, "acc_lim_th": 1.6, "acc_lim_y": 0.0}}
    loaded = load_configuration([robot({"scan": "LaserScan"}, **rollout)])
    sim = loaded.navstack.sim
    assert (sim.acc_lim_x, sim.acc_lim_y, sim.acc_lim_theta) == (1.25, None, 1.6)
    [found] = [f for f in loaded.findings if f.rule == "assumed-base"]
    assert "acc_lim_x = 1.25, acc_lim_theta = 1.6" in found.message
    # what says something about the base is kept; DWA commands what can be reached within a period
    for more in ({"navstack": {"sim": {"kinematics": "differential"}}, **rollout}, {}):
        other = load_configuration([robot({"scan": "LaserScan"}, **more)])
        assert other.navstack.sim.acc_lim_x is None
        assert not [f for f in other.findings if f.rule == "assumed-base"]


@pytest.mark.parametrize("kind", ["PointCloud2", "PointCloud"])  # PointCloud is the default of ROS 1
def test_a_cloud_is_simulated_from_the_same_rays(kind: str) -> None:
    loaded = load_configuration([robot({"scan": "LaserScan", "camera/points": kind})])
    scan, cloud = lidars(loaded).values()
    assert (scan.message, cloud.message, cloud.topic) == ("LaserScan", kind, "camera/points")
    assert (scan.fov, scan.range_max) == (cloud.fov, cloud.range_max)
    assert not [f for f in loaded.findings if f.rule == "nothing-feeds"]


SENSOR = """
  <gazebo reference="{link}"><sensor type="{kind}" name="s"><update_rate>20</update_rate><ray>
    <scan><horizontal><samples>{samples}</samples><min_angle>{low}</min_angle><max_angle>{high}</max_angle></horizontal></scan>
    <range><min>0.1</min><max>{far}</max></range></ray>
    <plugin name="p" filename="libgazebo_ros_laser.so"><topicName>{topic}</topicName><frameName>{link}</frameName></plugin>
  </sensor></gazebo>
"""
JOINT = (
    '<joint name="{link}_joint" type="fixed"><origin xyz="{xyz}" rpy="{rpy}"/><parent link="{parent}"/>'
    '<child link="{link}"/></joint>'
)


def urdf(*parts: str) -> str:
    return (
        f'<?xml version="1.0"?>\n<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{"".join(parts)}</robot>'
    )


def sensor(link: str, topic: str, low: str = "-2.0", high: str = "2.0", far: str = "12", kind: str = "ray") -> str:
    return SENSOR.format(link=link, topic=topic, low=low, high=high, far=far, kind=kind, samples=401)


def test_two_lasers_of_a_urdf_with_their_mounting(tmp_path: Path) -> None:
    package = tmp_path / "robot_navigation"
    (package / "urdf").mkdir(parents=True)
    (package / "urdf" / "robot.urdf").write_text(
        urdf(
            JOINT.format(link="base_link", parent="base_footprint", xyz="0 0 0.1", rpy="0 0 0"),
            JOINT.format(link="front", parent="base_link", xyz="0.3 0.1 0.2", rpy="0 0 0.5"),
            JOINT.format(link="rear", parent="base_link", xyz="-0.3 0 0.15", rpy="3.14159265 0 3.14159265"),
            sensor("front", "/front/scan"),
            sensor("rear", "rear/scan", low="-1.0", high="2.0", kind="gpu_ray"),
        )
    )
    (package / "params.yaml").write_text("{}\n")
    (package / "package.xml").write_text("<package><name>robot_navigation</name></package>")
    loaded = load_configuration(
        [str(package / "params.yaml"), robot({"front/scan": "LaserScan", "rear/scan": "LaserScan"})]
    )
    front, rear = lidars(loaded).values()
    assert (front.topic, front.frame, front.beams, front.frequency) == ("front/scan", "front", 401, 20.0)
    assert (front.x, front.y, front.yaw, front.height, front.fov) == pytest.approx((0.3, 0.1, 0.5, 0.3, 4.0))
    assert (front.range_min, front.range_max) == (0.1, 12.0)
    # upside down: its left is on the right, so the middle of -1 .. 2 rad is at -0.5 rad from its axis
    assert (rear.topic, rear.x, rear.fov) == ("rear/scan", pytest.approx(-0.3), pytest.approx(3.0))
    assert abs(math.remainder(rear.yaw - (math.pi - 0.5), 2.0 * math.pi)) < 1e-6
    assert not [f for f in loaded.findings if f.rule == "assumed-lidar"]
    assert {f.rule for f in loaded.findings} >= {"described-lidar"}
    # a record keeps the tree: its lidars do not depend on the file later
    (package / "urdf" / "robot.urdf").unlink()
    assert lidars(load_configuration([loaded.tree.as_dict()])) == {"laser": front, "laser_2": rear}


MACRO = """
  <xacro:arg name="range" default="8"/>
  <xacro:property name="half" value="${radians(240) / 2}"/>
  <xacro:macro name="lidar" params="link topic far:=5 *origin">
    <joint name="${link}_joint" type="fixed"><xacro:insert_block name="origin"/>
      <parent link="base_link"/><child link="${link}"/></joint>
    %s
  </xacro:macro>
  <xacro:if value="${half > 1}">
    <xacro:lidar link="laser" topic="scan" far="$(arg range)"><origin xyz="${0.1 + 0.05} 0 0.2"/></xacro:lidar>
  </xacro:if>
  <xacro:unless value="true"><xacro:lidar link="other" topic="scan_2"><origin xyz="0 0 0"/></xacro:lidar></xacro:unless>
"""


def test_xacro_macros_arguments_and_filters(tmp_path: Path) -> None:
    description, navigation = tmp_path / "description", tmp_path / "navigation"
    for folder in (description, navigation):
        folder.mkdir()
        (folder / "package.xml").write_text(f"<package><name>{folder.name}</name></package>")
    body = MACRO % sensor("${link}", "${topic}", "${-half}", "${half}", "${far}")
    (description / "lidar.xacro").write_text(f"<robot>{body}</robot>")
    (description / "robot.xacro").write_text(urdf('<xacro:include filename="$(find description)/lidar.xacro"/>'))
    (navigation / "filter.yaml").write_text(
        "scan_filter_chain:\n- {name: a, type: laser_filters/LaserScanAngularBoundsFilter, "
        "params: {lower_angle: -1, upper_angle: 1.5}}\n"
    )
    command = "$(find xacro)/xacro '$(find description)/robot.xacro' range:=9"
    (navigation / "a.launch").write_text(
        f'<launch><param name="robot_description" command="{command}"/>'
        '<node pkg="move_base" type="move_base" name="move_base"/></launch>'
    )
    loaded = load_configuration([str(navigation / "a.launch"), robot({"scan_filtered": "LaserScan"})])
    [lidar] = lidars(loaded).values()
    assert (lidar.topic, lidar.range_max, lidar.x) == ("scan_filtered", 9.0, pytest.approx(0.15))
    assert (lidar.fov, lidar.yaw) == pytest.approx((2.5, 0.25))
    # before the filter, and without the launch file the default of the argument
    (navigation / "a.yaml").write_text("planner_frequency: 0.0\n")
    near = load_configuration([str(navigation / "a.yaml"), robot({"scan": "LaserScan"})])
    [lidar] = lidars(near).values()
    assert (lidar.range_max, lidar.fov, lidar.yaw) == pytest.approx((8.0, math.radians(240.0), 0.0))


def test_the_record_of_a_run_and_a_contact_name_the_assumed_sensor() -> None:
    configuration = load_configuration([robot({"scan": "LaserScan"})])
    [advice] = collision_advice(configuration.findings)
    assert "it is assumed: 270 degrees" in advice


def test_robots_of_which_none_is_meant_give_no_lidar(tmp_path: Path) -> None:
    for name, far in (("burger", "3.5"), ("waffle", "8.0")):
        joint = JOINT.format(link="laser", parent="base_link", xyz="0 0 0", rpy="0 0 0")
        (tmp_path / f"robot_{name}.urdf").write_text(urdf(joint, sensor("laser", "scan", far=far)))
    (tmp_path / "move_base_params.yaml").write_text("planner_frequency: 0.0\n")
    either = load_configuration([str(tmp_path), robot({"scan": "LaserScan"})])
    assert [f.rule for f in either.findings if "lidar" in f.rule] == ["assumed-lidar"]
    chosen = load_configuration([str(tmp_path), "model:=burger", robot({"scan": "LaserScan"})])
    assert [lidar.range_max for lidar in lidars(chosen).values()] == [3.5]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "<robot",
        urdf(sensor("laser", "scan")),  # no joint: nobody knows where it is
        urdf(JOINT.format(link="laser", parent="laser", xyz="0 0 0", rpy="0 0 0"), sensor("laser", "scan")),
        urdf(JOINT.format(link="laser", parent="base_link", xyz="a b", rpy="0"), sensor("laser", "scan")),
        urdf(JOINT.format(link="laser", parent="base_link", xyz="0 0 0", rpy="0 0 0"), sensor("laser", "s", low="x")),
        urdf(JOINT.format(link="laser", parent="base_link", xyz="0 0 0", rpy="0 0 0"), sensor("laser", "s", far="inf")),
        urdf('<xacro:macro name="m" params=""><xacro:m/></xacro:macro><xacro:m/>'),
        urdf('<xacro:include filename="a.xacro"/>'),
    ],
)
def test_descriptions_that_cannot_be_used_give_no_lidar(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.xacro").write_text(text)
    assert lidars_of(tmp_path / "a.xacro", {}) == []
