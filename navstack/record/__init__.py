"""The record of a run: written by `RunRecorder`, read by `Record` for pictures, diagnostics and reports.

`navstack.record.format` describes the file.
"""

from navstack.record.entries import RecordedLocalPlan, RecordedPlan, RecordedScan
from navstack.record.reader import Record
from navstack.record.recorder import RunRecorder
from navstack.record.steering import SteeredBase

__all__ = ["Record", "RecordedLocalPlan", "RecordedPlan", "RecordedScan", "RunRecorder", "SteeredBase"]
