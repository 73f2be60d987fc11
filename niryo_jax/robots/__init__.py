"""Robots that come with the package."""

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

__all__ = [
    "MODELS",
    "NIRYO_NED",
    "NIRYO_NED2",
    "NIRYO_ONE",
    "NiryoModel",
    "niryo_ned",
    "niryo_ned2",
    "niryo_one",
]
