"""Whether an arm touches itself or what stands around it, and how far it is from that.

Links are capsules (`CollisionModel`), obstacles half spaces, boxes, spheres and capsules (`World`).
"""

from niryo_jax.collision.check import CollisionCheck
from niryo_jax.collision.clearance import (
    Distances,
    clearance,
    collides,
    distances,
)
from niryo_jax.collision.model import CollisionModel
from niryo_jax.collision.niryo import niryo_ned, niryo_ned2, niryo_one, shipped
from niryo_jax.collision.sampling import Pruned, prune
from niryo_jax.collision.segments import box_distance, segment_distance
from niryo_jax.collision.skeleton import skeleton
from niryo_jax.collision.urdf import from_urdf
from niryo_jax.collision.verdict import Free, FreeStatus, free
from niryo_jax.collision.world import World

__all__ = [
    "CollisionCheck",
    "CollisionModel",
    "Distances",
    "Free",
    "FreeStatus",
    "Pruned",
    "World",
    "box_distance",
    "clearance",
    "collides",
    "distances",
    "free",
    "from_urdf",
    "niryo_ned",
    "niryo_ned2",
    "niryo_one",
    "prune",
    "segment_distance",
    "shipped",
    "skeleton",
]
