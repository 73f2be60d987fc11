"""A map on disk: an xarray Dataset in a Zarr store, written chunk by chunk.

A chunk counts as done once its checksum is stored, which is the last thing written of it. So a run
that is killed leaves whole chunks and chunks that are not done, and damage shows in the checksum.
Every file is written beside its place and renamed, by Zarr and here.
"""

from __future__ import annotations

import json
import os
import shutil
import uuid
import zlib
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from niryo_jax.extras import need
from niryo_jax.workspace.layout import CHECKSUM, NOT_DONE, QUATERNIONS, lay_out
from niryo_jax.workspace.spec import Chunk, MapSpec
from niryo_jax.workspace.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr


_KEPT = " The chunks that are done are kept; the map can be resumed."


class StoreError(Exception):
    """A map's store cannot be used or written; what is stored of it is kept."""


class MapStore:
    """The store of one map.

    Args:
        where: the directory of the store, or None for one in memory.
    """

    def __init__(self, where: Path | None, group: Any) -> None:
        self._where = where
        self._group = group

    @classmethod
    def create(cls, where: Path | None, spec: MapSpec) -> MapStore:
        """The store of a map: a new one, or that which is there and was made the same way.

        Raises:
            StoreError: what is there is something else or was made with other parameters; or
                nothing can be written.
        """
        zarr = need("zarr")
        if where is None:
            store = zarr.storage.MemoryStore()
            lay_out(zarr, store, spec)
            return cls(None, zarr.open_group(store, mode="r+"))
        if not where.exists():
            with _refusing(where, "make the store", ""):
                _make(zarr, where, spec)
        found = cls.open(where)
        found.refuse_other(spec)
        return found

    @classmethod
    def open(cls, where: Path, *, read_only: bool = False) -> MapStore:
        """The store of a map that is there.

        Raises:
            StoreError: there is none, or it is damaged.
        """
        zarr = need("zarr")
        if not where.exists():
            raise StoreError(f"{where}: there is no such store")
        if not (where / "zarr.json").is_file():
            raise StoreError(
                f"{where}: this is no capability map (no zarr.json); it is left as it is"
            )
        try:
            group = zarr.open_group(str(where), mode="r" if read_only else "r+")
            missing = {CHECKSUM, QUATERNIONS} - set(group.array_keys())
        except (ValueError, TypeError, KeyError, json.JSONDecodeError) as error:
            raise StoreError(f"{where}: its metadata are damaged: {error}") from error
        if missing:
            raise StoreError(
                f"{where}: this is no capability map (without {', '.join(sorted(missing))}); it is "
                "left as it is"
            )
        return cls(where, group)

    @property
    def name(self) -> str:
        """The store as errors call it."""
        return "the map in memory" if self._where is None else str(self._where)

    def spec(self) -> MapSpec:
        """What the map is of.

        Raises:
            StoreError: the attributes do not say.
        """
        try:
            spec = MapSpec.from_attributes(self._group.attrs, self._group[QUATERNIONS][:])
        except ValueError as error:
            raise StoreError(f"{self.name}: {error}") from error
        chunks = self._group[CHECKSUM].shape
        if chunks != (spec.chunk_count,):
            raise StoreError(
                f"{self.name}: it is damaged: {spec.chunk_count} chunks by its attributes, {chunks}"
            )
        return spec

    def refuse_other(self, spec: MapSpec) -> None:
        """Refuse a map that is not this one to the last bit.

        Raises:
            StoreError: naming what differs: parameters, versions, precision or platform.
        """
        have, want = dict(self._group.attrs), spec.attributes()
        differing = [key for key in want if have.get(key) != want[key]]
        same_set = np.array_equal(self._group[QUATERNIONS][:], spec.quaternions)
        if not differing and same_set:
            return
        said = [f"{key} = {_short(have.get(key))}, not {_short(want[key])}" for key in differing]
        raise StoreError(
            f"{self.name}: it was made with {'; '.join(said or ['other orientations'])}. Name "
            "another store, or ask for the same map."
        )

    def done(self) -> np.ndarray:
        """(chunks,) which chunks are stored whole."""
        return self._group[CHECKSUM][:] != NOT_DONE

    def missing(self) -> int:
        """How many chunks are not stored yet."""
        return int(np.sum(~self.done()))

    def write(self, chunk: Chunk, arrays: Mapping[str, np.ndarray]) -> None:
        """Store a chunk, and then that it is done.

        Raises:
            StoreError: nothing can be written.
        """
        with _refusing(self.name, f"write chunk {chunk.number}"):
            for name, array in arrays.items():
                self._group[name][_place(name, chunk)] = array
            self._group[CHECKSUM][chunk.number] = _checksum(arrays)

    def damaged(self, chunks: Iterable[Chunk]) -> list[Chunk]:
        """Which of these chunks are said to be done and are not as they were written."""
        there, checksums = set(self._group.array_keys()), self._group[CHECKSUM][:]
        arrays = {name: self._group[name] for name in VARIABLES if name in there}
        return [
            chunk
            for chunk in chunks
            if checksums[chunk.number] != NOT_DONE
            and checksums[chunk.number] != _checksum_of(arrays, chunk)
        ]

    def forget(self, chunk: Chunk) -> None:
        """Note that a chunk is not done.

        Raises:
            StoreError: nothing can be written.
        """
        with _refusing(self.name, f"mark chunk {chunk.number}"):
            self._group[CHECKSUM][chunk.number] = NOT_DONE

    def dataset(self) -> xr.Dataset:
        """The map; what lies on a disk is read when it is looked at."""
        xarray = need("xarray")
        opened = xarray.open_zarr(
            self._group.store, consolidated=False, chunks=None, mask_and_scale=False
        )
        dataset = opened[[name for name in (*VARIABLES, QUATERNIONS) if name in opened]]
        if self._where is None:
            dataset.load()
        if missing := self.missing():
            dataset.attrs["chunks_missing"] = missing
        return dataset

    @contextmanager
    def locked(self, share: int) -> Generator[None]:
        """Keep other processes from computing the same share of the map.

        Raises:
            StoreError: another process does.
        """
        if self._where is None:
            yield
            return
        filelock = need("filelock")
        # Where neither Zarr nor xarray look for members of the group.
        lock = filelock.FileLock(self._where / CHECKSUM / f".lock-{share}")
        with _refusing(self._where, "lock the store"):
            try:
                lock.acquire(timeout=0)
            except filelock.Timeout:
                raise StoreError(
                    f"{self._where}: another process is computing this map (share {share}); it "
                    "holds its lock until it ends"
                ) from None
        try:
            yield
        finally:
            lock.release()


def _place(name: str, chunk: Chunk) -> tuple[slice, ...]:
    """Where a chunk lies in a variable."""
    if VARIABLES[name].of_chunks:
        return (slice(chunk.number, chunk.number + 1),)
    return chunk.place


def _checksum(arrays: Mapping[str, np.ndarray]) -> int:
    """A number of all that a chunk holds, never that of one that is not done."""
    value = 0
    for name in sorted(arrays):
        value = zlib.crc32(np.ascontiguousarray(arrays[name]).tobytes(), value)
    return value + 1


def _checksum_of(arrays: Mapping[str, Any], chunk: Chunk) -> int:
    """The checksum of what is stored of a chunk."""
    try:
        return _checksum({name: array[_place(name, chunk)] for name, array in arrays.items()})
    except (ValueError, RuntimeError, OSError):
        # Each decoder refuses what is damaged in its own way.
        return NOT_DONE


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) < 60 else f"{text[:57]}..."


@contextmanager
def _refusing(where: Path | str, what: str, rest: str = _KEPT) -> Generator[None]:
    """Errors of the file system as a sentence, and another one."""
    try:
        yield
    except OSError as error:
        raise StoreError(f"{where}: cannot {what}: {error.strerror or error}.{rest}") from error


def _make(zarr: Any, where: Path, spec: MapSpec) -> None:
    """Lay out a store beside its place, and move it there in one step."""
    where.parent.mkdir(parents=True, exist_ok=True)
    beside = where.with_name(f".{where.name}.{uuid.uuid4().hex}.partial")
    try:
        lay_out(zarr, str(beside), spec)
        try:
            os.rename(beside, where)
        except OSError:
            # Another process was sooner; whether its map is this one is looked at next.
            if not (where / "zarr.json").is_file():
                raise
    finally:
        shutil.rmtree(beside, ignore_errors=True)
