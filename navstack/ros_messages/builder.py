"""navstack's types as ROS messages of rosbags, for ROS 1 and ROS 2."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    Costmap,
    DockDetection,
    ImuReading,
    LaserScan,
    OccupancyGrid,
    PointCloud,
    Pose2D,
    RangeReading,
    Transform2D,
    Twist2D,
    Window,
)
from navstack.ros_messages.transforms import Quaternion, quaternion_of_yaw

_FLOAT32: Final = 7
"""Datatype of a PointField."""


def published_costs() -> NDArray[np.int8]:
    """Return the value of nav_msgs/OccupancyGrid for each cost 0 .. 255, as costmap_2d publishes it."""
    costs = np.arange(256)
    values = 1 + (97 * (costs - 1)) // 251
    values[0], values[253], values[254], values[255] = 0, 99, 100, -1
    return values.astype(np.int8)


_PUBLISHED: Final = published_costs()


LINE_STRIP, LINE_LIST, SPHERE_LIST = 4, 5, 7
"""Kinds of visualization_msgs/Marker."""


class MessageBuilder:
    """Builds messages from a typestore of rosbags. Times are in nanoseconds."""

    def __init__(self, store: Any, *, ros1: bool) -> None:
        self._types = store.types
        self._ros1 = ros1
        self._no_covariance = np.zeros(36)

    def of(self, kind: str, **fields: Any) -> Any:
        """Return a message of the type `kind`."""
        return self._types[kind](**fields)

    def time(self, time_ns: int) -> Any:
        """Return a time."""
        return self.of("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)

    def header(self, time_ns: int, frame: str) -> Any:
        """Return a header."""
        sequence = {"seq": 0} if self._ros1 else {}
        return self.of("std_msgs/msg/Header", **sequence, stamp=self.time(time_ns), frame_id=frame)

    def quaternion(self, value: Quaternion | tuple[float, ...]) -> Any:
        """Return a quaternion (x, y, z, w)."""
        x, y, z, w = value
        return self.of("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def vector(self, x: float, y: float, z: float) -> Any:
        """Return a Vector3."""
        return self.of("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))

    def pose(self, pose: Pose2D) -> Any:
        """Return a pose on the ground."""
        return self.of(
            "geometry_msgs/msg/Pose",
            position=self.of("geometry_msgs/msg/Point", x=float(pose.x), y=float(pose.y), z=0.0),
            orientation=self.quaternion(quaternion_of_yaw(float(pose.yaw))),
        )

    def pose_stamped(self, time_ns: int, frame: str, pose: Pose2D) -> Any:
        """Return a pose with a header."""
        return self.of("geometry_msgs/msg/PoseStamped", header=self.header(time_ns, frame), pose=self.pose(pose))

    def detection(self, time_ns: int, found: DockDetection) -> Any:
        """Return a PoseStamped of the marker of a dock."""
        at = self.of("geometry_msgs/msg/Point", x=found.x, y=found.y, z=0.0)
        pose = self.of("geometry_msgs/msg/Pose", position=at, orientation=self.quaternion(found.orientation))
        return self.of("geometry_msgs/msg/PoseStamped", header=self.header(time_ns, found.frame), pose=pose)

    def transforms(self, items: Sequence[tuple[int, str, str, Transform2D, float]]) -> Any:
        """Return a TFMessage of (time, parent, child, transform, height)."""
        return self.of(
            "tf2_msgs/msg/TFMessage",
            transforms=[
                self.transform(time_ns, parent, child, (at.x, at.y, height), quaternion_of_yaw(float(at.yaw)))
                for time_ns, parent, child, at, height in items
            ],
        )

    def transform(
        self, time_ns: int, parent: str, child: str, translation: tuple[float, float, float], rotation: Quaternion
    ) -> Any:
        """Return a TransformStamped of a transform in space."""
        return self.of(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(time_ns, parent),
            child_frame_id=child,
            transform=self.of(
                "geometry_msgs/msg/Transform",
                translation=self.vector(*translation),
                rotation=self.quaternion(rotation),
            ),
        )

    def twist(self, twist: Twist2D) -> Any:
        """Return a velocity."""
        return self.of(
            "geometry_msgs/msg/Twist",
            linear=self.vector(twist.vx, twist.vy, 0.0),
            angular=self.vector(0.0, 0.0, twist.wz),
        )

    def twist_stamped(self, time_ns: int, frame: str, twist: Twist2D) -> Any:
        """Return a velocity with a header."""
        return self.of("geometry_msgs/msg/TwistStamped", header=self.header(time_ns, frame), twist=self.twist(twist))

    def odometry(
        self,
        time_ns: int,
        frame: str,
        child: str,
        pose: Pose2D,
        velocity: Twist2D,
        covariance: Sequence[float] | None = None,
    ) -> Any:
        """Return an odometry message; `covariance` (36) is that of pose and velocity, zeros without one."""
        spread = self._no_covariance if covariance is None else np.array(covariance)
        return self.of(
            "nav_msgs/msg/Odometry",
            header=self.header(time_ns, frame),
            child_frame_id=child,
            pose=self.of("geometry_msgs/msg/PoseWithCovariance", pose=self.pose(pose), covariance=spread),
            twist=self.of("geometry_msgs/msg/TwistWithCovariance", twist=self.twist(velocity), covariance=spread),
        )

    def scan(self, time_ns: int, scan: LaserScan) -> Any:
        """Return a scan."""
        count = len(scan.ranges)
        return self.of(
            "sensor_msgs/msg/LaserScan",
            header=self.header(time_ns, scan.frame),
            angle_min=scan.angle_min,
            angle_max=scan.angle_min + scan.angle_increment * max(count - 1, 0),
            angle_increment=scan.angle_increment,
            time_increment=0.0,
            scan_time=0.0,
            range_min=scan.range_min,
            range_max=scan.range_max,
            ranges=np.asarray(scan.ranges, np.float32),
            intensities=np.empty(0, np.float32),
        )

    def range(self, time_ns: int, reading: RangeReading) -> Any:
        """Return the reading of a sonar."""
        return self.of(
            "sensor_msgs/msg/Range",
            header=self.header(time_ns, reading.frame),
            radiation_type=0,
            field_of_view=reading.field_of_view,
            min_range=reading.min_range,
            max_range=reading.max_range,
            range=reading.range_m,
        )

    def cloud(self, time_ns: int, cloud: PointCloud) -> Any:
        """Return a point cloud of x, y, z."""
        return self.points(time_ns, cloud.frame, "xyz", cloud.points)

    def points(self, time_ns: int, frame: str, names: Sequence[str], rows: NDArray[np.floating[Any]]) -> Any:
        """Return a PointCloud2 of (n, k) values with the names of its k fields."""
        data = np.ascontiguousarray(rows, np.float32)
        fields = [
            self.of("sensor_msgs/msg/PointField", name=name, offset=4 * i, datatype=_FLOAT32, count=1)
            for i, name in enumerate(names)
        ]
        step = 4 * len(names)
        return self.of(
            "sensor_msgs/msg/PointCloud2",
            header=self.header(time_ns, frame),
            height=1,
            width=len(data),
            fields=fields,
            is_bigendian=False,
            point_step=step,
            row_step=step * len(data),
            data=np.frombuffer(data.tobytes(), np.uint8),
            is_dense=True,
        )

    def imu(self, time_ns: int, reading: ImuReading) -> Any:
        """Return the reading of an IMU at rest but for its rotation about z."""
        return self.of(
            "sensor_msgs/msg/Imu",
            header=self.header(time_ns, reading.frame),
            orientation=self.quaternion(reading.orientation),
            orientation_covariance=np.zeros(9),
            angular_velocity=self.vector(0.0, 0.0, reading.yaw_rate),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self.vector(0.0, 0.0, 9.81),
            linear_acceleration_covariance=np.array([-1.0, *([0.0] * 8)]),
        )

    def image(self, time_ns: int, frame: str, encoding: str, pixels: NDArray[Any]) -> Any:
        """Return an image of pixels (height, width) or (height, width, channels); `encoding` as in sensor_msgs."""
        pixels = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<"))
        return self.of(
            "sensor_msgs/msg/Image",
            header=self.header(time_ns, frame),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=pixels.strides[0],
            data=pixels.view(np.uint8).reshape(-1),
        )

    def camera_info(
        self, time_ns: int, frame: str, width: int, height: int, focal_length: float, center: tuple[float, float]
    ) -> Any:
        """Return the calibration of a pinhole camera without distortion; focal length and center in pixels."""
        u, v = center
        matrix = np.array([focal_length, 0.0, u, 0.0, focal_length, v, 0.0, 0.0, 1.0])
        projection = np.array([focal_length, 0.0, u, 0.0, 0.0, focal_length, v, 0.0, 0.0, 0.0, 1.0, 0.0])
        values = {"D": np.zeros(5), "K": matrix, "R": np.eye(3).ravel(), "P": projection}
        return self.of(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(time_ns, frame),
            height=height,
            width=width,
            distortion_model="plumb_bob",
            **{name if self._ros1 else name.lower(): value for name, value in values.items()},
            binning_x=0,
            binning_y=0,
            roi=self.of(
                "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
            ),
        )

    # --- grids --------------------------------------------------------------------------------------------------------

    def map(self, time_ns: int, grid: OccupancyGrid) -> Any:
        """Return the map as map_server publishes it."""
        geometry = grid.geometry
        origin = Pose2D(geometry.origin_x, geometry.origin_y, grid.origin_yaw)
        data = np.asarray(grid.data, np.int8)
        return self._grid(time_ns, grid.frame, geometry.resolution, origin, data, loaded_ns=time_ns)

    def costmap(self, time_ns: int, costmap: Costmap) -> Any:
        """Return a whole costmap as costmap_2d publishes it."""
        return self.values(time_ns, costmap, _PUBLISHED[costmap.data])

    def values(self, time_ns: int, costmap: Costmap, values: NDArray[np.int8]) -> Any:
        """Return a grid of values (ny, nx) at the place of a costmap. It has no load time, unlike a map."""
        geometry = costmap.geometry
        origin = Pose2D(geometry.origin_x, geometry.origin_y, 0.0)
        return self._grid(time_ns, costmap.frame, geometry.resolution, origin, values, loaded_ns=0)

    def costmap_update(self, time_ns: int, costmap: Costmap, window: Window) -> Any:
        """Return the cells of a window."""
        part = costmap.data[window.y0 : window.y1, window.x0 : window.x1]
        return self.of(
            "map_msgs/msg/OccupancyGridUpdate",
            header=self.header(time_ns, costmap.frame),
            x=int(window.x0),
            y=int(window.y0),
            width=part.shape[1],
            height=part.shape[0],
            data=_PUBLISHED[part].ravel(),
        )

    def _grid(
        self, time_ns: int, frame: str, resolution: float, origin: Pose2D, data: NDArray[np.int8], *, loaded_ns: int
    ) -> Any:
        info = self.of(
            "nav_msgs/msg/MapMetaData",
            map_load_time=self.time(loaded_ns),
            resolution=resolution,
            width=data.shape[1],
            height=data.shape[0],
            origin=self.pose(origin),
        )
        return self.of(
            "nav_msgs/msg/OccupancyGrid",
            header=self.header(time_ns, frame),
            info=info,
            data=np.ascontiguousarray(data).ravel(),
        )

    # --- plans --------------------------------------------------------------------------------------------------------

    def path(self, time_ns: int, frame: str, poses: NDArray[np.float64]) -> Any:
        """Return a path of poses (n, 3)."""
        return self.of(
            "nav_msgs/msg/Path",
            header=self.header(time_ns, frame),
            poses=[self.pose_stamped(time_ns, frame, Pose2D(*row)) for row in poses.tolist()],
        )

    def polygon(self, time_ns: int, frame: str, corners: NDArray[np.float64]) -> Any:
        """Return a polygon (n, 2) on the ground."""
        points = [self.of("geometry_msgs/msg/Point32", x=x, y=y, z=0.0) for x, y in corners.tolist()]
        return self.of(
            "geometry_msgs/msg/PolygonStamped",
            header=self.header(time_ns, frame),
            polygon=self.of("geometry_msgs/msg/Polygon", points=points),
        )

    def line_marker(
        self,
        time_ns: int,
        frame: str,
        name: str,
        points: NDArray[np.float64],
        *,
        rgb: tuple[float, float, float] = (0.0, 0.45, 0.7),
    ) -> Any:
        """Return a MarkerArray with one line through points (n, >= 2)."""
        marker = self.marker(time_ns, frame, name, points, kind=LINE_STRIP, size=0.02, rgb=rgb)
        return self.of("visualization_msgs/msg/MarkerArray", markers=[marker])

    def marker(
        self,
        time_ns: int,
        frame: str,
        name: str,
        points: NDArray[np.float64],
        *,
        kind: int,
        size: float,
        rgb: tuple[float, float, float] = (0.0, 0.45, 0.7),
    ) -> Any:
        """Return a Marker of points (n, >= 2): LINE_STRIP, LINE_LIST or SPHERE_LIST, with lines and spheres of a `size` (m)."""
        color = self.of("std_msgs/msg/ColorRGBA", r=rgb[0], g=rgb[1], b=rgb[2], a=1.0)
        duration = {"sec": 0, "nanosec": 0}
        extra = (
            {}
            if self._ros1
            else {
                "texture_resource": "",
                "texture": self.of(
                    "sensor_msgs/msg/CompressedImage",
                    header=self.header(0, ""),
                    format="",
                    data=np.empty(0, np.uint8),
                ),
                "uv_coordinates": [],
                "mesh_file": self.of("visualization_msgs/msg/MeshFile", filename="", data=np.empty(0, np.uint8)),
            }
        )
        return self.of(
            "visualization_msgs/msg/Marker",
            header=self.header(time_ns, frame),
            ns=name,
            id=0,
            type=kind,
            action=0,
            pose=self.pose(Pose2D(0.0, 0.0)),
            scale=self.vector(size, *((size, size) if kind == SPHERE_LIST else (0.0, 0.0))),
            color=color,
            lifetime=self.of("builtin_interfaces/msg/Duration", **duration),
            frame_locked=False,
            points=[self.of("geometry_msgs/msg/Point", x=p[0], y=p[1], z=0.05) for p in points[:, :2].tolist()],
            colors=[],
            text="",
            mesh_resource="",
            mesh_use_embedded_materials=False,
            **extra,
        )
