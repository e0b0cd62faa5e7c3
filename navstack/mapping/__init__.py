"""Mapping: a map from raw scans, by matching them, recognizing places, and solving the graph of the poses (SLAM)."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.mapping.loops import Loop as Loop
    from navstack.mapping.mapper import Mapper as Mapper
    from navstack.mapping.mapper import MatchResult as MatchResult
    from navstack.mapping.params import MapperParams as MapperParams
    from navstack.mapping.pose_graph import Edge as Edge
    from navstack.mapping.pose_graph import PoseGraph as PoseGraph
    from navstack.mapping.pose_graph import Solution as Solution
    from navstack.mapping.pose_graph import read_g2o as read_g2o
    from navstack.mapping.pose_graph import solve as solve
    from navstack.mapping.pose_graph import write_g2o as write_g2o
    from navstack.mapping.report import judge_mounting as judge_mounting
    from navstack.mapping.report import report_document as report_document
    from navstack.mapping.session import load_session as load_session
    from navstack.mapping.session import save_session as save_session
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
