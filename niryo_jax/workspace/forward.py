"""Where the tool comes to when the joints are moved evenly: a histogram of billions of positions.

The cheap companion of a capability map. It says how often a voxel is met, not whether a pose in it
can be reached: a voxel without samples may still be reachable.
"""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import ArrayLike

from niryo_jax.arguments import check_count
from niryo_jax.chain import joint_motion
from niryo_jax.execution.devices import cores
from niryo_jax.extras import need
from niryo_jax.lanes import Lane
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.specialise import Geometry, specialised
from niryo_jax.workspace.extent import box, joint_ranges
from niryo_jax.workspace.progress import Progress
from niryo_jax.workspace.variables import VOXELS

if TYPE_CHECKING:
    import xarray as xr

_WORD = 2**32
_PART = 2**24
"""Samples of one call of the program at most; no power of two crosses a multiple of 2^32."""
_BLOCK = 2**16
"""Samples counted at once on a CPU, in whose cache they stay."""
_BLOCK_ON_ACCELERATOR = 2**22
_ULPS = 32
"""A position this near to the outside of the grid, in units of rounding, is in its edge voxel."""


def forward_map(
    robot: Robot,
    samples: int,
    *,
    voxel: float,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> xr.Dataset:
    """How many of evenly spread joint vectors bring the tool's origin into each voxel.

    In the precision that JAX is set to; memory does not grow with the samples. The same numbers
    give the same counts whatever the number of cores.

    Args:
        robot: the arm.
        samples: how many joint vectors (`joint_samples`); billions are fine.
        voxel: length of a voxel's edge, metres.
        bounds: (3,) and (3,) corners of the box, metres; all that the arm can reach if not given.
        seed: which set of joint vectors.
        progress: called with the samples done and the samples in all, e.g. what
            `workspace.progress_bar` gives.

    Returns:
        A Dataset with `samples` (x, y, z) int64, the coordinates of the voxels' centres, and as
        attributes robot_name, voxel, samples, seed, dtype, and `outside`: how many fell outside
        of the box.

    Raises:
        ValueError: less than one sample, a negative seed, a prismatic joint without limits, more
            voxels than 2^31, and what `box` refuses.
        ImportError: xarray is not installed.
    """
    xarray = need("xarray")
    check_is_robot(robot)
    _check_samples(samples, seed)
    low, high = joint_ranges(robot)
    grid = box(robot, bounds, voxel)
    if grid.size >= 2**31:
        raise ValueError(f"voxel: {voxel} m makes {grid.size} voxels; at most 2^31 can be counted")

    dtype = jnp.result_type(float)
    ranges = jnp.asarray(low, dtype), jnp.asarray(high, dtype)
    threads = cores()
    part = min(_PART, 1 << (-(-samples // threads) - 1).bit_length())
    options = {
        "first": grid.first,
        "shape": grid.shape,
        "voxel": grid.voxel,
        "block": _BLOCK if jax.default_backend() == "cpu" else _BLOCK_ON_ACCELERATOR,
    }

    def counted(first: int) -> np.ndarray:
        start = jnp.asarray(_words(robot.joints, np.array([first], np.uint64), seed)[0])
        number = jnp.asarray(min(part, samples - first), jnp.uint32)
        return np.asarray(_count(robot, *ranges, start, number, **options))

    counts = np.zeros(grid.size + 1, np.int64)
    starts = range(0, samples, part)
    with ThreadPoolExecutor(threads) as pool:
        # A precision that was chosen for a `with` block holds in its own thread only.
        alike = pool.submit(jnp.result_type, float).result() == dtype
        for begin in range(0, len(starts), threads):
            some = starts[begin : begin + threads]
            for result in (pool.map if alike else map)(counted, some):
                counts += result
            if progress is not None:
                progress(min(some[-1] + part, samples), samples)

    text = {"long_name": "joint samples that bring the tool into the voxel", "units": "1"}
    return xarray.Dataset(
        {"samples": (VOXELS, counts[:-1].reshape(grid.shape), text)},
        coords=grid.coordinates,
        attrs={
            "robot_name": robot.name,
            "voxel": grid.voxel,
            "samples": samples,
            "seed": seed,
            "outside": samples - int(counts[:-1].sum()),
            "dtype": dtype.name,
        },
    )


def joint_samples(robot: Robot, samples: int, *, first: int = 0, seed: int = 0) -> jax.Array:
    """Joint vectors spread evenly over the box of the joint limits, of an endless sequence.

    Sample k of joint i is at the share (k A_i + c_i) mod 2^32 of its range, with A_i / 2^32 the
    i-th power of the inverse of the generalised golden ratio (the Kronecker sequence R_n of M.
    Roberts, The unreasonable effectiveness of quasirandom sequences, 2018), in whole numbers, so
    that any part can be had by itself. The shift c_i comes from the seed, and changes every 2^32
    samples, after which the sequence would repeat.

    Args:
        robot: the arm. Revolute limits wider than a turn count as a turn.
        samples: how many, at most 2^24 at once.
        first: the number of the first one.
        seed: which shifts.

    Returns:
        (samples, n) joint vectors in the precision that JAX is set to, radians (metres for
        prismatic joints).

    Raises:
        ValueError: less than one sample or more than 2^24, a negative first or seed, a prismatic
            joint without limits.
    """
    check_is_robot(robot)
    _check_samples(samples, seed)
    check_count("samples", samples, 1, _PART)
    check_count("first", first, 0, sys.maxsize - _PART)
    low, high = (jnp.asarray(limit, float) for limit in joint_ranges(robot))
    words = _words(robot.joints, np.arange(first, first + samples, dtype=np.uint64), seed)
    return _joint_value(jnp.asarray(words), low, high)


def _check_samples(samples: int, seed: int) -> None:
    """Raise a ValueError unless there is a sample to draw and the seed is not negative."""
    check_count("samples", samples, 1, sys.maxsize)
    check_count("seed", seed, 0, sys.maxsize)


def _steps(joints: int) -> np.ndarray:
    """(n,) A_i: powers of 1/x, where x^(n+1) = x + 1, as odd shares of 2^32."""
    ratio = 2.0
    for _ in range(64):
        ratio = (1.0 + ratio) ** (1.0 / (joints + 1))
    shares = ratio ** -np.arange(1.0, joints + 1)
    return (shares * _WORD).astype(np.uint64) | np.uint64(1)


def _words(joints: int, places: np.ndarray, seed: int) -> np.ndarray:
    """(k, n) uint32: where the samples of these numbers lie in the joints' ranges."""
    rounds, within = np.divmod(places, np.uint64(_WORD))
    shifts = [
        np.random.default_rng([seed, int(number)]).integers(_WORD, size=joints, dtype=np.uint64)
        for number in range(int(rounds[0]), int(rounds[-1]) + 1)
    ]
    words = within[:, None] * _steps(joints) + np.stack(shifts)[rounds - rounds[0]]
    return words.astype(np.uint32)


def _joint_value(words: jax.Array, low: jax.Array, high: jax.Array) -> jax.Array:
    """From 2^32 equal pieces of a range to their middles."""
    # Signed words convert to floating point in one vector instruction, unsigned ones do not.
    signed = lax.bitcast_convert_type(words, jnp.int32).astype(low.dtype)
    return 0.5 * (low + high) + (signed + 0.5) * ((high - low) * (1.0 / _WORD))


@specialised
def _count(
    geometry: Geometry,
    low: jax.Array,
    high: jax.Array,
    start: jax.Array,
    number: jax.Array,
    first: tuple[int, int, int],
    shape: tuple[int, int, int],
    voxel: float,
    block: int,
) -> jax.Array:
    """(voxels + 1,) int32 counts of so many samples from a word on; the last is for the others."""
    steps = _steps(geometry.joints).astype(np.uint32)
    size = shape[0] * shape[1] * shape[2]
    farthest = max(max(abs(at), abs(at + count)) for at, count in zip(first, shape))
    slack = _ULPS * float(jnp.finfo(low.dtype).eps) * farthest

    def voxels(places: jax.Array) -> jax.Array:
        # From the tool inwards each joint moves one point; no rotation has to be composed.
        point = geometry.home[:3, 3]
        for i in reversed(range(geometry.joints)):
            q = _joint_value(places * steps[i] + start[i], low[i], high[i])
            rotation, position = joint_motion(geometry, i, Lane(q))
            point = rotation @ point + position
        inside, index = places < number, jnp.int32(0)
        for coordinate, at, count in zip(point, first, shape):
            offset = (coordinate * (1.0 / voxel) - float(at)).array
            inside &= (offset >= -slack) & (offset < count + slack)
            along = jnp.clip(lax.floor(offset).astype(jnp.int32), 0, count - 1)
            index = index * count + along
        return jnp.where(inside, index, size)

    def add(number: jax.Array, counts: jax.Array) -> jax.Array:
        places = lax.iota(jnp.uint32, block) + number * np.uint32(block)
        return counts.at[voxels(places)].add(1, mode="promise_in_bounds")

    blocks = (number + np.uint32(block - 1)) // np.uint32(block)
    return lax.fori_loop(np.uint32(0), blocks, add, jnp.zeros(size + 1, jnp.int32))
