"""Trajectories between two joint vectors or poses, ways through many, and joint rates for twists.

Lynch & Park, *Modern Robotics*, sections 9.1 and 9.2.
"""

from niryo_jax.motion.best_path import BestPath, best_path
from niryo_jax.motion.curves import arc, blend
from niryo_jax.motion.limits import CartesianLimits, MotionLimits, niryo_limits
from niryo_jax.motion.paths import (
    JointTrajectory,
    PoseTrajectory,
    cartesian_trajectory,
    joint_trajectory,
    screw_trajectory,
)
from niryo_jax.motion.point_to_point import PointToPoint, point_to_point
from niryo_jax.motion.retiming import retime
from niryo_jax.motion.rungs import PathCost
from niryo_jax.motion.time_scaling import TimeScaling, cubic_time_scaling, quintic_time_scaling
from niryo_jax.motion.timed_path import TimedPath
from niryo_jax.motion.velocity import velocity_ik
from niryo_jax.motion.velocity_result import VelocityResult, VelocityStatus

__all__ = [
    "BestPath",
    "CartesianLimits",
    "JointTrajectory",
    "MotionLimits",
    "PathCost",
    "PointToPoint",
    "PoseTrajectory",
    "TimeScaling",
    "TimedPath",
    "VelocityResult",
    "VelocityStatus",
    "arc",
    "best_path",
    "blend",
    "cartesian_trajectory",
    "cubic_time_scaling",
    "joint_trajectory",
    "niryo_limits",
    "point_to_point",
    "quintic_time_scaling",
    "retime",
    "screw_trajectory",
    "velocity_ik",
]
