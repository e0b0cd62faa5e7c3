"""The parameters of the supervision of a localizer: when the robot counts as lost, and how it finds itself."""

from typing import Self

from pydantic import model_validator

from navstack.plugins import ParamModel, param


class LostParams(ParamModel):
    """When a robot counts as lost. The defaults were calibrated; see the page about localization."""

    lost_explained: float = param(
        0.65, "share of explained beams below which a scan contradicts the believed pose", gt=0.0, lt=1.0
    )
    lost_evidence: float = param(
        2.5, "sum of the missing shares, scan by scan, from which the robot counts as lost", gt=0.0
    )
    lost_continuous: float = param(
        0.65,
        "share of beams that agree with the scan before, by the odometry, below which the robot may have been carried away",
        ge=0.0,
        lt=1.0,
    )
    lost_explained_then: float = param(
        0.85, "lost_explained from then on, until the scans have confirmed the believed pose", gt=0.0, lt=1.0
    )
    lost_interval: float = param(0.2, "scans sooner after the last one that counted are left out", unit="s", ge=0.0)
    lost_beams: int = param(60, "beams that are compared", ge=10, le=2000)

    @model_validator(mode="after")
    def _check_shares(self) -> Self:
        if self.lost_explained_then < self.lost_explained:
            raise ValueError(
                f"lost_explained_then {self.lost_explained_then:g} is below lost_explained {self.lost_explained:g}: a robot that "
                "may have been carried away would need less agreement with the map than any other; set it to at least that"
            )
        return self


class ScanMatcherParams(ParamModel):
    """How a pose is found without a start, and followed by matching scans."""

    update_min_d: float = param(0.25, "distance to move before a scan counts", unit="m", ge=0.0)
    update_min_a: float = param(0.2, "angle to turn before a scan counts", unit="rad", ge=0.0)
    max_hypotheses: int = param(200, "hypotheses that are tracked separately", ge=1, le=5000)
    search_beams: int = param(180, "beams of a search over the whole map", ge=10, le=255)
    match_beams: int = param(60, "beams of a match", ge=10, le=2000)
    search_distance: float = param(1.0, "distance to move before the whole map is searched again", unit="m", gt=0.0)
    search_turn: float = param(1.5, "angle to turn before the whole map is searched again", unit="rad", gt=0.0)
    window: int = param(20, "scans by which hypotheses are compared", ge=2, le=500)
    certain_probability: float = param(
        0.99, "probability of the best hypothesis from which it is certain", gt=0.5, lt=1.0
    )
    certain_explained: float = param(0.6, "share of beams that a certain pose explains", ge=0.0, le=1.0)
    certain_distance: float = param(1.0, "distance moved before a pose found by a search is certain", unit="m", ge=0.0)
    certain_turn: float = param(
        6.0,
        "angle turned before such a pose is certain; half of it and half of certain_distance do, too",
        unit="rad",
        gt=0.0,
    )


class SearchingParams(ScanMatcherParams, LostParams):
    """Namespace `supervision`: how amcl or scan matching is supervised, when the robot counts as lost and how it finds itself."""

    search: bool = param(True, "search the whole map while the robot is lost and after a start without a pose")
    same_pose_m: float = param(0.5, "a search that ends this near the believed pose confirms it", unit="m", gt=0.0)
    same_pose_rad: float = param(0.3, "the same of the heading", unit="rad", gt=0.0)
    handed_hypotheses: int = param(
        20,
        "at most this many possible poses are handed to the tracker while none is certain; 1: only certain ones",
        ge=1,
        le=200,
    )
