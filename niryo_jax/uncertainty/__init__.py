"""What errors of the joints make of the pose of the tool: by formula, and by trying it many times.

Frames have the names of `niryo_jax.differential`.
"""

from niryo_jax.uncertainty import figures
from niryo_jax.uncertainty.comparison import Comparison, compare
from niryo_jax.uncertainty.ellipsoid import Ellipsoid, position_ellipsoid
from niryo_jax.uncertainty.noise import (
    Backlash,
    Bias,
    Combined,
    EncoderSteps,
    Gaussian,
    GearRatio,
    Noise,
    Uniform,
)
from niryo_jax.uncertainty.propagation import (
    Propagated,
    Sensitivity,
    least_sensitive,
    propagate,
    sensitivity,
)
from niryo_jax.uncertainty.trials import MonteCarlo, monte_carlo

__all__ = [
    "Backlash",
    "Bias",
    "Combined",
    "Comparison",
    "Ellipsoid",
    "EncoderSteps",
    "Gaussian",
    "GearRatio",
    "MonteCarlo",
    "Noise",
    "Propagated",
    "Sensitivity",
    "Uniform",
    "compare",
    "figures",
    "least_sensitive",
    "monte_carlo",
    "position_ellipsoid",
    "propagate",
    "sensitivity",
]
