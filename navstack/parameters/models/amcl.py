"""The parameters of amcl (noetic: amcl; Nav2: nav2_amcl)."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Final, Literal, Self, get_args

from pydantic import field_validator, model_validator

from navstack.parameters.models.velocity_smoother import ROS2_NO_EFFECT
from navstack.plugins import ParamModel, param

Defect = Literal[
    "half_cell",
    "distance_field",
    "yaw_bins",
    "one_bin_max",
    "average_weight",
    "beam_nan",
    "beam_skip",
    "axis_threshold",
]
DEFECTS: Final[frozenset[Defect]] = frozenset(get_args(Defect))
"""Defects of noetic's amcl that are corrected here, by the names of the parity page."""
OdometryModel = Literal["diff", "omni", "diff-corrected", "omni-corrected"]
_NAV2_MODELS: Final[Mapping[str, OdometryModel]] = {
    "nav2_amcl::DifferentialMotionModel": "diff-corrected",
    "nav2_amcl::OmniMotionModel": "omni-corrected",
    "differential": "diff-corrected",
    "omnidirectional": "omni-corrected",
}


class InitialPoseParams(ParamModel):
    """Namespace `initial_pose`, as Nav2 writes it."""

    x: float = param(0.0, "x in the map", unit="m")
    y: float = param(0.0, "y in the map", unit="m")
    z: float = param(0.0, "no effect: poses are planar", unit="m")
    yaw: float = param(0.0, "heading in the map", unit="rad")


class AmclParams(ParamModel):
    """Namespace `amcl`: Monte Carlo localization. Names and defaults of noetic; Nav2's names are read, too."""

    RENAMED: ClassVar[Mapping[str, str]] = {
        "pf_err": "kld_err",
        "pf_z": "kld_z",
        "max_beams": "laser_max_beams",
        "z_hit": "laser_z_hit",
        "z_short": "laser_z_short",
        "z_max": "laser_z_max",
        "z_rand": "laser_z_rand",
        "sigma_hit": "laser_sigma_hit",
        "lambda_short": "laser_lambda_short",
        "robot_model_type": "odom_model_type",
        "alpha1": "odom_alpha1",
        "alpha2": "odom_alpha2",
        "alpha3": "odom_alpha3",
        "alpha4": "odom_alpha4",
        "alpha5": "odom_alpha5",
        "beam_skip_error_threshold_": "beam_skip_error_threshold",
    }
    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        **ROS2_NO_EFFECT,
        "use_map_topic": "the map is passed by the program",
        "first_map_only": "the map is passed by the program",
        "save_pose_rate": "navstack stores no pose between runs",
        "saved_pose_filepath": "navstack stores no pose between runs",
        "initialize_at_saved_pose": "navstack stores no pose between runs",
        "gui_publish_rate": "it has no effect in noetic either",
        "tf_broadcast": "map -> odom is always set",
        "transform_tolerance": "map -> odom holds until the next one",
        "bag_scan_period": "navstack reads bags without pauses",
        "std_warn_level_x": "the estimate has its covariance; there are no diagnostics topics",
        "std_warn_level_y": "the estimate has its covariance; there are no diagnostics topics",
        "std_warn_level_yaw": "the estimate has its covariance; there are no diagnostics topics",
        "restore_defaults": "leave the parameters out for their defaults",
        "always_reset_initial_pose": "every start begins at the initial pose",
        "scan_topic": "the scans are those of the robot's lidars",
        "map_topic": "the map is passed by the program",
        "allow_parameter_qos_overrides": "navstack has no topics",
        "freespace_downsampling": "every free cell is kept",
        "set_initial_pose": "the start is always known: initial_pose, or global localization",
    }

    min_particles: int = param(100, "least number of particles", ge=1, le=1_000_000)
    max_particles: int = param(5000, "greatest number of particles", ge=1, le=1_000_000)
    kld_err: float = param(0.01, "bound of the KL distance between the particles and the true distribution", gt=0.0)
    kld_z: float = param(
        0.99,
        "quantile of the normal distribution that keeps the bound: 2.33 for a probability of 0.99. The default is amcl's, which "
        "takes the probability for the quantile",
        ge=0.0,
    )
    update_min_d: float = param(0.2, "motion before a scan is used", unit="m", ge=0.0)
    update_min_a: float = param(math.pi / 6.0, "turn before a scan is used", unit="rad", ge=0.0)
    resample_interval: int = param(2, "updates per resampling", ge=1)
    selective_resampling: bool = param(
        False, "resample only when the effective number is at most half of the particles"
    )
    recovery_alpha_slow: float = param(
        0.001, "rate of the slow average of the weights; 0: no random poses", ge=0.0, le=1.0
    )
    recovery_alpha_fast: float = param(
        0.1, "rate of the fast average of the weights; 0: no random poses", ge=0.0, le=1.0
    )
    laser_max_beams: int = param(30, "beams used of each scan; below 2, scans change nothing", ge=0)
    laser_min_range: float = param(-1.0, "shorter readings are none; negative: the scan's limit", unit="m")
    laser_max_range: float = param(-1.0, "greatest range; negative: the scan's", unit="m")
    laser_model_type: Literal["beam", "likelihood_field", "likelihood_field_prob"] = param(
        "likelihood_field",
        "beam: ranges against rays through the map; likelihood_field: end points against the nearest obstacle, summed; "
        "likelihood_field_prob: the same, multiplied, with beam skipping",
    )
    laser_z_hit: float = param(0.95, "share of hits in the mixture", ge=0.0)
    laser_z_short: float = param(0.1, "share of unexpected obstacles (model beam)", ge=0.0)
    laser_z_max: float = param(0.05, "share of readings without a return (model beam)", ge=0.0)
    laser_z_rand: float = param(0.05, "share of random readings", ge=0.0)
    laser_sigma_hit: float = param(0.2, "standard deviation of a hit", unit="m", gt=0.0)
    laser_lambda_short: float = param(0.1, "decay of unexpected obstacles (model beam)", unit="1/m", ge=0.0)
    laser_likelihood_max_dist: float = param(
        2.0, "greatest distance to an obstacle that is distinguished", unit="m", gt=0.0
    )
    do_beamskip: bool = param(False, "leave out beams that few particles explain (likelihood_field_prob)")
    beam_skip_distance: float = param(0.5, "a beam is explained by a closer obstacle", unit="m", ge=0.0)
    beam_skip_threshold: float = param(0.3, "share of particles that must explain a beam", ge=0.0, le=1.0)
    beam_skip_error_threshold: float = param(0.9, "all beams are used if this share would be left out", ge=0.0, le=1.0)
    odom_model_type: OdometryModel = param(
        "diff", "motion model; diff and omni take variances for standard deviations, as amcl before 2012"
    )
    odom_alpha1: float = param(0.2, "noise of the rotation from rotation", ge=0.0)
    odom_alpha2: float = param(0.2, "noise of the rotation from translation", ge=0.0)
    odom_alpha3: float = param(0.2, "noise of the translation from translation", ge=0.0)
    odom_alpha4: float = param(0.2, "noise of the translation from rotation", ge=0.0)
    odom_alpha5: float = param(0.2, "noise across the translation (omni models)", ge=0.0)
    odom_frame_id: str = param("odom", "odometry frame")
    base_frame_id: str = param("base_link", "base frame")
    global_frame_id: str = param("map", "map frame")
    force_update_after_initialpose: bool = param(False, "the first scan after an initial pose is used at once")
    force_update_after_set_map: bool = param(False, "the first scan after a map is used at once")
    initial_pose_x: float = param(0.0, "x at the start", unit="m")
    initial_pose_y: float = param(0.0, "y at the start", unit="m")
    initial_pose_a: float = param(0.0, "heading at the start", unit="rad")
    initial_cov_xx: float = param(0.25, "variance of x at the start", unit="m²", ge=0.0)
    initial_cov_yy: float = param(0.25, "variance of y at the start", unit="m²", ge=0.0)
    initial_cov_aa: float = param((math.pi / 12.0) ** 2, "variance of the heading at the start", unit="rad²", ge=0.0)
    initial_pose: InitialPoseParams | None = param(None, "pose at the start, as Nav2 writes it")
    random_seed: int = param(-1, "seed of the particles; negative: that of the run", le=0xFFFFFFFF)
    learn_odometry: bool = param(
        True,
        "each particle also estimates the turn error of the odometry per meter, as unequal wheels cause it; not in amcl",
    )
    ros_defects: list[Defect] = param([], "defects of noetic's amcl to reproduce, see the parity page; not in amcl")

    @field_validator("odom_model_type", mode="before")
    @classmethod
    def _read_nav2_model(cls, value: Any) -> Any:
        return _NAV2_MODELS.get(value.replace("/", "::"), value) if isinstance(value, str) else value

    @field_validator("odom_frame_id", "base_frame_id", "global_frame_id")
    @classmethod
    def _strip_slash(cls, value: str) -> str:
        return value.removeprefix("/")

    @model_validator(mode="after")
    def _check_counts(self) -> Self:
        if self.min_particles > self.max_particles:
            raise ValueError(
                f"min_particles is {self.min_particles}, above max_particles, {self.max_particles}; lower it or raise the other"
            )
        if self.recovery_alpha_slow > self.recovery_alpha_fast:
            raise ValueError(
                f"recovery_alpha_slow is {self.recovery_alpha_slow}, above recovery_alpha_fast, {self.recovery_alpha_fast}; the "
                "slow average must not be the faster one"
            )
        return self

    @property
    def start(self) -> tuple[float, float, float]:
        """Pose at the start: x, y (m), yaw (rad)."""
        pose = self.initial_pose
        if pose is not None:
            return pose.x, pose.y, pose.yaw
        return self.initial_pose_x, self.initial_pose_y, self.initial_pose_a

    @property
    def alphas(self) -> tuple[float, float, float, float, float]:
        """`odom_alpha1` to `odom_alpha5`."""
        return self.odom_alpha1, self.odom_alpha2, self.odom_alpha3, self.odom_alpha4, self.odom_alpha5
