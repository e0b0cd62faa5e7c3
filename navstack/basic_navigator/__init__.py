"""Nav2's simple commander on a `MoveBase`."""

from navstack.basic_navigator.navigator import BasicNavigator
from navstack.basic_navigator.task import NO_ERROR, PASSED_RADIUS_M, POLL_S, TaskFeedback, TaskResult

__all__ = ["NO_ERROR", "PASSED_RADIUS_M", "POLL_S", "BasicNavigator", "TaskFeedback", "TaskResult"]
