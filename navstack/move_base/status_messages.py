"""The texts of move_base and actionlib, to the letter, because clients compare them.

Source: move_base/src/move_base.cpp, actionlib/include/actionlib/server/{action_server_base,simple_action_server_imp}.h.
"""

from __future__ import annotations

from typing import Final

# actionlib; the spelling "recieved" is that of the source
ACCEPTED: Final = "This goal has been accepted by the simple action server"
REPLACED: Final = "This goal was canceled because another goal was recieved by the simple action server"
CANCELED_BEFORE: Final = (
    "This goal handle was canceled by the action server because its timestamp is before the timestamp of the last "
    "cancel request"
)
NOT_FINISHED: Final = (
    "This goal was aborted by the simple action server. The user should have set a terminal status on this goal and "
    "did not"
)

# move_base: status texts
REACHED: Final = "Goal reached."
CANCELED: Final = ""
BAD_QUATERNION: Final = "Aborting on goal because it was sent with an invalid quaternion"
PLAN_REFUSED: Final = "Failed to pass global plan to the controller."
NO_PLAN: Final = "Failed to find a valid plan. Even after executing recovery behaviors."
NO_CONTROL: Final = "Failed to find a valid control. Even after executing recovery behaviors."
OSCILLATING: Final = "Robot is oscillating. Even after executing recovery behaviors."
BAD_STATE: Final = "Reached a case that should not be hit in move_base. This is a bug, please report it."
KILLED: Final = "Aborting on the goal because the node has been killed"

# additions: ROS never ends such a goal
STALE_SENSORS: Final = "Sensor data is out of date: the robot was stopped for safety and no new data arrived."
BAD_POSITION: Final = "Aborting on goal because its position is not a finite number"
TIME_LIMIT: Final = "Aborting on goal because its time limit has expired"
LOST: Final = "The robot does not know where it is: it was stopped, and did not find itself."
DRIVER_FAILED: Final = "Aborting on goal because the robot rejects commands"

# move_base: log
LOG_STALE: Final = "[{name}]:Sensor data is out of date, we're not going to allow commanding of the base for safety"
LOG_NO_PLAN: Final = "Aborting because a valid plan could not be found. Even after executing all recovery behaviors"
LOG_NO_CONTROL: Final = (
    "Aborting because a valid control could not be found. Even after executing all recovery behaviors"
)
LOG_OSCILLATING: Final = (
    "Aborting because the robot appears to be oscillating over and over. Even after executing all recovery behaviors"
)
LOG_LOST: Final = "Aborting because the robot is lost. Even after executing all recovery behaviors"
LOG_NEW_PLAN: Final = "Got new plan"
LOG_REACHED: Final = "Goal reached"
LOG_BUSY: Final = "move_base must be in an inactive state to make a plan for an external user"
