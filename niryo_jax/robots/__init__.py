"""Robots that come with the package, and robots from elsewhere."""

from niryo_jax.robots.book import (
    abb_irb120,
    abb_irb910sc,
    abb_irb1600,
    abb_irb6620lx,
    kuka_iiwa14,
    niryo_one_report,
    rttr,
    ur16e,
)
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
    "abb_irb120",
    "abb_irb910sc",
    "abb_irb1600",
    "abb_irb6620lx",
    "from_dh",
    "from_mjcf",
    "from_urdf",
    "kuka_iiwa14",
    "load",
    "names",
    "niryo_ned",
    "niryo_ned2",
    "niryo_one",
    "niryo_one_report",
    "rttr",
    "to_urdf",
    "ur16e",
]
