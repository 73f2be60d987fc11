"""What several uses make together: a worn arm, calibrated; a plan as one timed trajectory."""

from niryo_jax.studies.block_stacking import (
    PARAMETERS,
    StackingStudy,
    block_stacking,
    instrument,
    postures,
    typical_wear,
)
from niryo_jax.studies.figures import stacking_figure
from niryo_jax.studies.timed_clearance import check_timed
from niryo_jax.studies.timed_execution import TimedRecord, execute_timed
from niryo_jax.studies.timed_figure import timed_figure
from niryo_jax.studies.timed_plan import TimedPlan, TimedStep, timed_plan

__all__ = [
    "PARAMETERS",
    "StackingStudy",
    "TimedPlan",
    "TimedRecord",
    "TimedStep",
    "block_stacking",
    "check_timed",
    "execute_timed",
    "instrument",
    "postures",
    "stacking_figure",
    "timed_figure",
    "timed_plan",
    "typical_wear",
]
