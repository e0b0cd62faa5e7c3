"""The record of a run: written by `RunRecorder`, read by `Record` for pictures, diagnostics and reports.

`navstack.record.format` describes the file.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.record.buffers import SolidNames as SolidNames
    from navstack.record.buffers import copy_changed_window as copy_changed_window
    from navstack.record.columns import Table as Table
    from navstack.record.commands import RecordedCommand as RecordedCommand
    from navstack.record.commands import recorded_command as recorded_command
    from navstack.record.format import RUN_FILE as RUN_FILE
    from navstack.record.metrics import STALL_S as STALL_S
    from navstack.record.metrics import RunMetrics as RunMetrics
    from navstack.record.metrics import Stall as Stall
    from navstack.record.metrics import Timings as Timings
    from navstack.record.metrics import compute_metrics as compute_metrics
    from navstack.record.metrics import find_stalls as find_stalls
    from navstack.record.metrics import metrics_of as metrics_of
    from navstack.record.metrics import resampled_jerk as resampled_jerk
    from navstack.record.reader import Record as Record
    from navstack.record.reader import RecordedEstimate as RecordedEstimate
    from navstack.record.reader import RecordedLocalPlan as RecordedLocalPlan
    from navstack.record.reader import RecordedPlan as RecordedPlan
    from navstack.record.reader import RecordedScan as RecordedScan
    from navstack.record.reader import believed_poses as believed_poses
    from navstack.record.reader import estimate_at as estimate_at
    from navstack.record.reader import estimates_of as estimates_of
    from navstack.record.reader import moved as moved
    from navstack.record.reader import recorded_estimate as recorded_estimate
    from navstack.record.recorder import RunRecorder as RunRecorder
    from navstack.record.recorder import record_tick_outputs as record_tick_outputs
    from navstack.record.social import PeopleTrack as PeopleTrack
    from navstack.record.social import SocialMetrics as SocialMetrics
    from navstack.record.social import social_metrics as social_metrics
    from navstack.record.steering import SteeredBase as SteeredBase
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
