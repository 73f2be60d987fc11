"""A worn arm stacks blocks, is calibrated from thirty poses, and stacks them again.

You learn: how to simulate a worn arm, measure it, fit it, and plan with the fitted arm, complete
inverse kinematics included. Given a path, `main` draws the figure of docs/stacking.md.

Expected output:

    seed 0: 0 of 4 blocks in their cells, off by up to 2.03 mm; calibrated 4 of 4, 0.24 mm
    seed 1: 3 of 4 blocks in their cells, off by up to 0.98 mm; calibrated 4 of 4, 0.40 mm
    seed 2: 2 of 4 blocks in their cells, off by up to 1.13 mm; calibrated 4 of 4, 0.37 mm
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from niryo_jax.figures import save
from niryo_jax.hardware.stacking import Placed
from niryo_jax.studies import StackingStudy, block_stacking, stacking_figure


class Result(NamedTuple):
    studies: list[StackingStudy]
    before: list[int]
    after: list[int]
    off: list[float]


def main(seeds: int = 3, picture: Path | None = None) -> Result:
    jax.config.update("jax_enable_x64", True)
    result = Result([], [], [], [])
    for seed in range(seeds):
        study = block_stacking(seed)
        (before, was_off), (after, off) = map(_counted, (study.before, study.after))
        print(
            f"seed {seed}: {before} of 4 blocks in their cells, off by up to {was_off:.2f} mm; "
            f"calibrated {after} of 4, {off:.2f} mm"
        )
        for values, value in zip(result, (study, before, after, off)):
            values.append(value)
    if picture is not None:
        save(stacking_figure(result.studies[0]), picture)
    return result


def _counted(blocks: tuple[Placed, ...]) -> tuple[int, float]:
    """How many are in their cells, and the most by which one is off, millimetres."""
    farthest = max(float(np.abs(block.position[:2]).max()) for block in blocks)
    return sum(block.inside for block in blocks), 1e3 * farthest


if __name__ == "__main__":
    main(3, *map(Path, sys.argv[1:2]))
