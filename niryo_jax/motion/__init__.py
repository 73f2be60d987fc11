"""Trajectories between two joint vectors or poses, ways through many, and joint rates for twists.

Lynch & Park, *Modern Robotics*, sections 9.1 and 9.2.
"""

from niryo_jax.motion.best_path import BestPath, best_path
from niryo_jax.motion.paths import (
    JointTrajectory,
    PoseTrajectory,
    cartesian_trajectory,
    joint_trajectory,
    screw_trajectory,
)
from niryo_jax.motion.rungs import PathCost
from niryo_jax.motion.time_scaling import TimeScaling, cubic_time_scaling, quintic_time_scaling
from niryo_jax.motion.velocity import velocity_ik
from niryo_jax.motion.velocity_result import VelocityResult, VelocityStatus

__all__ = [
    "BestPath",
    "JointTrajectory",
    "PathCost",
    "PoseTrajectory",
    "TimeScaling",
    "VelocityResult",
    "VelocityStatus",
    "best_path",
    "cartesian_trajectory",
    "cubic_time_scaling",
    "joint_trajectory",
    "quintic_time_scaling",
    "screw_trajectory",
    "velocity_ik",
]
