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
    from navstack.mapping.merge import align as align
    from navstack.mapping.merge import compare as compare
    from navstack.mapping.merge import merged as merged
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
