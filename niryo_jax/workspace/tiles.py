"""From voxels to numbers, on all cores or all devices of this process.

The unit of work is a tile: so many voxels that a core keeps busy and memory stays small. Every
device runs the same program on tiles of one size, whatever their number, so that a map is the same,
bit for bit, however it was computed. Tiles need nothing of each other.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from niryo_jax.execution.devices import cores
from niryo_jax.ik.results.solutions import SLOTS
from niryo_jax.lie import se3
from niryo_jax.workspace.measures import PoseMeasures, measure
from niryo_jax.workspace.spec import Chunk, MapSpec
from niryo_jax.workspace.variables import MEASURES, VARIABLES

Arrays = dict[str, np.ndarray]

_POSES = 16_384
_POSES_ON_ACCELERATOR = 1_048_576


class Tile(NamedTuple):
    """Voxels that are computed in one call.

    Attributes:
        centres: (v, 3) metres; the last one again where there are no more.
        live: (v,) which of them are asked for.
    """

    centres: np.ndarray
    live: np.ndarray


class TileProgram:
    """The compiled program of a map, and the devices that run it."""

    def __init__(self, spec: MapSpec) -> None:
        self._spec = spec
        on_cpu = jax.default_backend() == "cpu"
        poses = _POSES if on_cpu else _POSES_ON_ACCELERATOR
        self._devices = jax.local_devices()
        self._per_device = max(1, poses // len(spec.quaternions))
        # A program waits for all its devices, one core for one tile: two keep either busy.
        self.calls_at_once = cores() if on_cpu and len(self._devices) == 1 else 2
        self._dtype = jnp.result_type(float)
        rotations = jnp.asarray(spec.rotations, self._dtype)

        def tile(rotations: jax.Array, centres: jax.Array, live: jax.Array) -> dict[str, jax.Array]:
            return _tile(spec, rotations, centres, live)

        if len(self._devices) == 1:
            self._rows = self._devices[0]
            self._rotations = jax.device_put(rotations, self._devices[0])
            self._program = jax.jit(tile)
            return
        mesh = Mesh(np.array(self._devices), ("voxels",))
        rows, same = PartitionSpec("voxels"), PartitionSpec()
        self._rows = NamedSharding(mesh, rows)
        self._rotations = jax.device_put(rotations, NamedSharding(mesh, same))
        self._program = jax.jit(
            jax.shard_map(
                tile, mesh=mesh, in_specs=(same, rows, rows), out_specs=rows, check_vma=False
            )
        )

    @property
    def voxels(self) -> int:
        """How many voxels a tile has."""
        return self._per_device * len(self._devices)

    def tiles(self, chunk: Chunk) -> Iterator[Tile]:
        """The tiles of a chunk, z fastest."""
        axes = (axis[part] for axis, part in zip(self._spec.grid.centres, chunk.place))
        centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        for start in range(0, len(centres), self.voxels):
            some = centres[start : start + self.voxels]
            missing = self.voxels - len(some)
            yield Tile(
                np.pad(some, ((0, missing), (0, 0)), mode="edge"),
                np.arange(self.voxels) < len(some),
            )

    def __call__(self, tile: Tile) -> Arrays:
        """The numbers of a tile: one row for each voxel asked for, or for each device."""
        centres = jax.device_put(tile.centres.astype(self._dtype), self._rows)
        live = jax.device_put(tile.live, self._rows)
        found = jax.device_get(self._program(self._rotations, centres, live))
        out, asked = Arrays(), int(tile.live.sum())
        for name, variable in self._spec.variables.items():
            # Types are those of the store, which JAX has only with x64.
            array = found[name].astype(variable.dtype)
            out[name] = array if variable.of_chunks else array[:asked]
        return out


def compute(
    program: TileProgram,
    chunks: Iterable[Chunk],
    on_tile: Callable[[int], None],
) -> Iterator[tuple[Chunk, Arrays]]:
    """The numbers of chunks, one chunk after the other, few tiles ahead of what is taken.

    Args:
        program: the program of the map.
        chunks: those to compute.
        on_tile: called with the number of voxels of each tile that is done.
    """
    ahead = 2 * program.calls_at_once
    waiting = deque[tuple[Chunk, bool, Future[Arrays]]]()
    done = list[Arrays]()

    with ThreadPoolExecutor(program.calls_at_once) as pool:

        def take() -> Iterator[tuple[Chunk, Arrays]]:
            chunk, last, future = waiting.popleft()
            done.append(future.result())
            on_tile(len(done[-1]["reachability_index"]))
            if last:
                yield chunk, _joined(chunk, done)
                done.clear()

        try:
            for chunk in chunks:
                tiles = list(program.tiles(chunk))
                for number, tile in enumerate(tiles, 1):
                    waiting.append((chunk, number == len(tiles), pool.submit(program, tile)))
                    while len(waiting) > ahead:
                        yield from take()
            while waiting:
                yield from take()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _joined(chunk: Chunk, parts: list[Arrays]) -> Arrays:
    """A chunk of its tiles, in the shapes in which it is stored."""
    out = Arrays()
    for name in parts[0]:
        rows = np.concatenate([part[name] for part in parts])
        if VARIABLES[name].of_chunks:
            out[name] = rows.sum(axis=0, keepdims=True, dtype=rows.dtype)
        else:
            out[name] = rows.reshape(*chunk.shape, *rows.shape[1:])
    return out


def _tile(
    spec: MapSpec, rotations: jax.Array, centres: jax.Array, live: jax.Array
) -> dict[str, jax.Array]:
    """The variables of a map for voxels (v, 3), those of chunks summed into one row (1, ...)."""
    voxels, count = len(centres), len(rotations)
    pose = se3.from_rotation_and_position(rotations, centres[:, None])
    flat = measure(
        spec.robot,
        pose.reshape(-1, 4, 4),
        method=spec.method,
        length=spec.length,
        collisions=spec.collisions,
    )
    poses = PoseMeasures(*(x.reshape(voxels, count) for x in flat))
    reached = poses.solutions > 0
    some = jnp.any(reached, axis=1)
    number = jnp.sum(reached, axis=1)

    def share(which: jax.Array) -> jax.Array:
        return jnp.mean(which, axis=1, dtype=centres.dtype)

    out = {
        "reachability_index": share(reached),
        "reachability_index_unlimited": share(poses.solutions_unlimited > 0),
        "dexterous_fraction": share(reached & (poses.singular_value >= spec.dexterous)),
        "colliding_fraction": share(~reached & (poses.colliding > 0)),
        "undecided_fraction": share(~poses.complete),
        "solutions_mean": share(poses.solutions),
        "solutions_mean_unlimited": share(poses.solutions_unlimited),
        "solutions_most": jnp.max(poses.solutions, axis=1),
    }
    for name in MEASURES:
        values = getattr(poses, name)
        if name == "position_noise":
            best = jnp.min(jnp.where(reached, values, jnp.inf), axis=1)
        else:
            best = jnp.max(jnp.where(reached, values, -jnp.inf), axis=1)
        mean = jnp.sum(jnp.where(reached, values, 0.0), axis=1) / jnp.maximum(number, 1)
        out[f"{name}_best"] = jnp.where(some, best, jnp.nan)
        out[f"{name}_mean"] = jnp.where(some, mean, jnp.nan)
        out[f"pose_{name}"] = values
    out["pose_solutions"] = poses.solutions
    out["pose_solutions_unlimited"] = poses.solutions_unlimited
    asked = live[:, None]
    out["orientation_reached"] = jnp.sum(reached & asked, axis=0, keepdims=True)
    # Counting comparisons vectorises, where scattering into bins does not.
    bins = [jnp.sum((poses.solutions == k) & asked) for k in range(SLOTS + 1)]
    out["solution_histogram"] = jnp.stack(bins)[None]
    return {name: out[name] for name in spec.variables}
