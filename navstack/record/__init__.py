"""The record of a run: written once by `RunRecorder`, read by everything that looks back (`plot`, `explain`, reports).

See `navstack.record.format` for what is in the file.
"""

from navstack.record.reader import Record, RecordedLocalPlan, RecordedPlan, RecordedScan
from navstack.record.recorder import RunRecorder

__all__ = ["Record", "RecordedLocalPlan", "RecordedPlan", "RecordedScan", "RunRecorder"]
