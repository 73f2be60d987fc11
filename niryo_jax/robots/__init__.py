"""Robots that come with the package, and robots from elsewhere."""

from niryo_jax.robots.catalogue import load, names
from niryo_jax.robots.dh import from_dh
from niryo_jax.robots.mjcf import from_mjcf
from niryo_jax.robots.niryo import (
    MODELS,
    NIRYO_NED,
    NIRYO_NED2,
    NIRYO_ONE,
    NiryoModel,
    niryo_ned,
    niryo_ned2,
    niryo_one,
)
from niryo_jax.robots.urdf import from_urdf, to_urdf

__all__ = [
    "MODELS",
    "NIRYO_NED",
    "NIRYO_NED2",
    "NIRYO_ONE",
    "NiryoModel",
    "from_dh",
    "from_mjcf",
    "from_urdf",
    "load",
    "names",
    "niryo_ned",
    "niryo_ned2",
    "niryo_one",
    "to_urdf",
]
