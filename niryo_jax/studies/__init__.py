"""Studies that join hardware and calibration: what was done before and after, with numbers."""

from niryo_jax.studies.block_stacking import (
    PARAMETERS,
    StackingStudy,
    block_stacking,
    instrument,
    postures,
    typical_wear,
)
from niryo_jax.studies.figures import stacking_figure

__all__ = [
    "PARAMETERS",
    "StackingStudy",
    "block_stacking",
    "instrument",
    "postures",
    "stacking_figure",
    "typical_wear",
]
