"""Mapping: a map from raw scans, by matching them, recognizing places, and solving the graph of the poses (SLAM)."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.mapping.edit import crop as crop
    from navstack.mapping.edit import fill_holes as fill_holes
    from navstack.mapping.edit import keepout_mask as keepout_mask
    from navstack.mapping.edit import paint as paint
    from navstack.mapping.edit import remove_specks as remove_specks
    from navstack.mapping.edit import rotate as rotate
    from navstack.mapping.edit import wall_direction as wall_direction
    from navstack.mapping.exploration import Exploration as Exploration
    from navstack.mapping.exploration import drive_on as drive_on
    from navstack.mapping.exploration import exploration_report as exploration_report
    from navstack.mapping.exploration import goals_on as goals_on
    from navstack.mapping.exploration import overrides_for_exploration as overrides_for_exploration
    from navstack.mapping.mapper import Mapper as Mapper
    from navstack.mapping.merge import align as align
    from navstack.mapping.merge import compare as compare
    from navstack.mapping.merge import merged as merged
    from navstack.mapping.online import OnlineMapper as OnlineMapper
    from navstack.mapping.params import MapperParams as MapperParams
    from navstack.mapping.pose_graph import PoseGraph as PoseGraph
    from navstack.mapping.pose_graph import read_g2o as read_g2o
    from navstack.mapping.pose_graph import solve as solve
    from navstack.mapping.pose_graph import write_g2o as write_g2o
    from navstack.mapping.report import report_document as report_document
    from navstack.mapping.session import load_session as load_session
    from navstack.mapping.session import save_session as save_session
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
