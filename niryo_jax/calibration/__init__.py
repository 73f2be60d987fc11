"""Calibration: what an arm is, from what was measured of it (docs/calibration.md)."""

from niryo_jax.calibration.design import informative
from niryo_jax.calibration.files import read_measurements
from niryo_jax.calibration.fit import Calibration, Residuals, fit

__all__ = ["Calibration", "Residuals", "fit", "informative", "read_measurements"]
