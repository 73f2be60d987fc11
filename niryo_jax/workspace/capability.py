"""Capability maps: what an arm can reach, voxel by voxel and orientation by orientation."""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np

from niryo_jax.arguments import check_count, check_path, shown
from niryo_jax.collision import CollisionCheck
from niryo_jax.ik import Method
from niryo_jax.robot import Robot
from niryo_jax.workspace.orientations import Orientations
from niryo_jax.workspace.processes import await_others
from niryo_jax.workspace.progress import Progress
from niryo_jax.workspace.spec import Bounds, Chunk, MapSpec
from niryo_jax.workspace.store import MapStore, StoreError
from niryo_jax.workspace.tiles import TileProgram, compute

if TYPE_CHECKING:
    import xarray as xr

Share = tuple[int, int]
"""Which of how many shares of a map's chunks a process computes: (index, count)."""

_TRIED = 16


def capability_map(
    robot: Robot,
    voxel: float = 0.025,
    bounds: Bounds | None = None,
    orientations: int | Orientations = 200,
    *,
    store: str | PathLike[str] | None = None,
    full: bool = False,
    dexterous: float = 0.05,
    length: float = 1.0,
    method: Method | None = None,
    collisions: CollisionCheck | None = None,
    share: Share | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """What an arm can reach: every orientation at the centre of every voxel, solved completely.

    Args:
        robot: the arm; concrete.
        voxel: length of an edge, metres.
        bounds: lower and upper corner (3,) of the box, metres, space frame, widened to whole
            voxels; where not given, all that the tool can reach within the limits.
        orientations: how many, evenly spread (super-Fibonacci), or a set of
            `workspace.orientations`.
        store: directory of a Zarr store to write to, chunk by chunk. Where a run was ended, one
            with the same arguments goes on, and ends with the same bits.
        full: whether to keep the numbers of every single pose (`pose_...`), too.
        dexterous: smallest singular value from which on a posture is clear of singularities.
        length: metres by which the linear rows of the Jacobian are divided for singular values.
        method: as in `inverse_kinematics`; "complete" where the arm has one, and then the map is
            exact: a pose counts as not reached only where that is proved.
        collisions: what the arm has to stay clear of: itself, and a world in its space frame. A
            pose then counts as reached only where a solution within the limits does not collide,
            and measures are those of such solutions.
        share: (index, count): compute part of the chunks only, as one of so many processes that
            share the store. Where not given, that of this process under `jax.distributed`
            (`workspace.one_of_many`), and the call returns when the others have brought theirs.
        progress: called with the poses done and the poses in all, e.g. what
            `workspace.progress_bar` gives.

    Returns:
        The map, an `xarray.Dataset` (docs/workspace-maps.md says what each variable means). Where
        other processes have not computed their shares yet, its attribute `chunks_missing` says how
        many chunks are without values.

    Raises:
        ValueError: NaN limits, empty bounds, a voxel larger than the workspace, a share that is
            none, other arguments out of range.
        TypeError: a traced robot, no collision check.
        StoreError: the store is of another map, is in use, or cannot be written.
        ImportError: the extra `workspace` is not installed.
    """
    spec = MapSpec.of(
        robot, voxel, bounds, orientations, dexterous, length, method, full, collisions
    )
    part = _part(share)
    return _fill(MapStore.create(_path(store), spec), spec, part, progress, wait=share is None)


def resume(
    store: str | PathLike[str], *, share: Share | None = None, progress: Progress | None = None
) -> xr.Dataset:
    """Go on with the map of a store where its run was ended, and mend chunks that are damaged.

    Arguments, result and errors as `capability_map`; all else is read from the store.
    """
    check_path("store", store)
    part, found = _part(share), MapStore.open(Path(store))
    spec = found.spec()
    found.refuse_other(spec)
    return _fill(found, spec, part, progress, wait=share is None)


def open_map(
    store: str | PathLike[str], *, check: bool = True, partial: bool = False
) -> xr.Dataset:
    """The map of a store, which is read when it is looked at.

    Args:
        store: the directory.
        check: whether to read all of it first and compare its checksums.
        partial: whether a map that is not finished will do; voxels not computed yet are NaN.

    Raises:
        StoreError: there is no map, it is damaged, or it is not finished.
        ImportError: the extra `workspace` is not installed.
    """
    check_path("store", store)
    found = MapStore.open(Path(store), read_only=True)
    if check and (damaged := found.damaged(found.spec().chunks())):
        raise StoreError(
            f"{store}: chunks {_numbers(damaged)} are damaged; workspace.resume computes them again"
        )
    done = found.done()
    if not partial and not np.all(done):
        raise StoreError(
            f"{store}: {np.sum(done)} of {len(done)} chunks are done; workspace.resume goes on, "
            "partial=True opens what is there"
        )
    return found.dataset()


class Estimate(NamedTuple):
    """What a map will cost.

    Attributes:
        voxels, orientations, poses, chunks: how many there are.
        compile_seconds: until the first voxel is computed, once for a process.
        seconds: of computing all, on the devices of this process, by what a few tiles took.
        stored_bytes: of all variables, before they are compressed.
    """

    voxels: int
    orientations: int
    poses: int
    chunks: int
    compile_seconds: float
    seconds: float
    stored_bytes: int


def estimate(spec: MapSpec) -> Estimate:
    """What a map will cost, measured on tiles from all over it.

    Args:
        spec: `MapSpec.of` the arguments of `capability_map`.
    """
    if not isinstance(spec, MapSpec):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(f"spec: expected a MapSpec, got {shown(spec)}")
    program, chunks = TileProgram(spec), list(spec.chunks())
    some = chunks[:: max(1, len(chunks) // _TRIED)]
    started = time.perf_counter()
    program(next(program.tiles(some[0])))
    compiled = time.perf_counter()
    tried = list[int]()
    for _ in compute(program, (_middle(chunk, program.voxels) for chunk in some), tried.append):
        pass
    each = (time.perf_counter() - compiled) / sum(tried)
    stored = sum(
        math.prod(spec.sizes[dim] for dim in one.dims) * np.dtype(one.dtype).itemsize
        for one in spec.variables.values()
    )
    return Estimate(
        spec.grid.size,
        len(spec.quaternions),
        spec.poses,
        len(chunks),
        compiled - started,
        each * spec.grid.size,
        stored,
    )


def _middle(chunk: Chunk, voxels: int) -> Chunk:
    """A column of a chunk with about so many voxels, through its middle."""
    x, y, z = chunk.place
    rows = min(y.stop - y.start, max(1, voxels // (z.stop - z.start)))
    at, first = (x.start + x.stop) // 2, (y.start + y.stop - rows) // 2
    return chunk._replace(place=(slice(at, at + 1), slice(first, first + rows), z))


def _part(share: Share | None) -> Share:
    """The share that was asked for, or that of this process."""
    index, count = share = _pair(share) or (jax.process_index(), jax.process_count())
    if not 0 <= index < count:
        raise ValueError(f"share: expected (index, count) with 0 <= index < count, got {share}")
    return index, count


def _pair(share: Any) -> Share | None:
    """A share, which has to be two whole numbers."""
    if share is None:
        return None
    if not isinstance(share, Sequence) or isinstance(share, str) or len(share) != 2:
        raise TypeError(f"share: expected (index, count), got {shown(share)}")
    index, count = (check_count("share", x, 0, sys.maxsize) for x in share)
    return index, count


def _fill(
    store: MapStore, spec: MapSpec, share: Share, progress: Progress | None, *, wait: bool
) -> xr.Dataset:
    index, count = share
    with store.locked(index):
        mine = spec.share(index, count)
        for chunk in store.damaged(mine):
            warnings.warn(
                f"{store.name}: chunk {chunk.number} is damaged and computed again", stacklevel=3
            )
            store.forget(chunk)
        done = store.done()
        left = [chunk for chunk in mine if not done[chunk.number]]
        poses = len(spec.quaternions)
        total, missing = (sum(math.prod(c.shape) for c in some) * poses for some in (mine, left))
        computed = total - missing

        def advance(voxels: int) -> None:
            nonlocal computed
            computed += voxels * poses
            if progress is not None:
                progress(computed, total)

        if left:
            advance(0)
            for chunk, arrays in compute(TileProgram(spec), left, advance):
                store.write(chunk, arrays)
    if wait and count > 1:
        await_others(store.missing)
    return store.dataset()


def _path(store: str | PathLike[str] | None) -> Path | None:
    if store is not None:
        check_path("store", store)
    return None if store is None else Path(store)


def _numbers(chunks: list[Chunk]) -> str:
    most = 5
    named = ", ".join(str(chunk.number) for chunk in chunks[:most])
    return named if len(chunks) <= most else f"{named} and {len(chunks) - most} more"
