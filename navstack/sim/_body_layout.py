"""Layout of the state of the robot's body and of the samples that the kernels write."""

from __future__ import annotations

# layout of `state`
X, Y, YAW = 0, 1, 2  # true pose, map frame
VX, VY, WZ = 3, 4, 5  # velocity of the wheels
LX, LY, LZ = 6, 7, 8  # output of the velocity controller's lag
OX, OY, OYAW = 9, 10, 11  # odometry, odom frame
DISTANCE = 12  # travelled, m
COLLIDING = 13  # 1 from a collision until the robot has left it
CX, CY, CYAW = 14, 15, 16  # pose at that collision
OVERRUN = 17  # 1 while a moving obstacle overlaps the robot
GX, GY, GZ = 18, 19, 20  # change of the velocity in the last step
STEER, LSTEER = 21, 22  # steering angle; output of its controller's lag
COMMAND = (
    23  # first of the three command values: vx, vy, wz; of a steered base: vx (of the driven wheels), 0, steering angle
)
RIM = 26  # first of four velocities of the wheels' rims, m/s
ROLL = 30  # first of four ways of the rims since the start, m
TICK = 34  # first of four counts of the encoders
TARGET = 38  # first of four velocities that the rims should have, m/s
TRACTION = 42  # velocity of a driven and steered front wheel, m/s
STATE_SIZE = 43

# columns of `samples`
TRUE_POSE, ODOMETRY, VELOCITY = 0, 3, 6  # three columns each
IN_COLLISION = 9  # 1 while the robot is in collision
OVERRUN_HIT, DRIVEN_HIT = 10, 11  # what a new collision of the step hit (as `find_collision`), -1 for none
SAMPLE_SIZE = 12
