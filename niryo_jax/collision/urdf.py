"""Capsules from the collision geometry of a URDF description."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from niryo_jax.collision.model import CollisionModel
from niryo_jax.lie.rpy import pose_from_rpy
from niryo_jax.robots import description

_Capsule = tuple[np.ndarray, np.ndarray, float]
"""Start, end and radius in the frame of the geometry."""


def from_urdf(
    path: str | os.PathLike[str], base: str | None = None, tip: str | None = None
) -> CollisionModel:
    """Capsules that enclose the `collision` elements of a URDF description.

    A sphere is one as it stands; a cylinder is enclosed by the capsule of its radius and length, a
    box by one along its longest edges, a mesh by one along the principal axis of its vertices. A
    capsule may be much thicker than what it encloses: long boxes and meshes are better cut up.

    Links beside the chain (fingers of a gripper) belong to the link of the chain that carries them,
    their own joints at 0.

    Args:
        path: a URDF file, or its text, which starts with "<". Meshes are looked for relative to the
            file, `package://name/...` below the folders above it.
        base, tip: the ends of the chain, as for `robots.from_urdf`, which reads the robot.

    Returns:
        A `CollisionModel` in the frame of the base link, capsules named after their links, with the
        default pairs. `prune` finds those that always touch, and there will be some.

    Raises:
        ImportError: yourdfpy is not installed; trimesh, where there are meshes.
        FileNotFoundError: there is no such file, or mesh.
        ValueError: as `robots.from_urdf`; no collision geometry, or one that is none of the above.
    """
    model = description.parse(path)
    chain = description.chain(model, base, tip)
    placed = _placed(model, chain)
    folder = None if str(path).lstrip().startswith("<") else Path(path).resolve().parent
    starts, ends, radii = list[np.ndarray](), list[np.ndarray](), list[float]()
    links, names = list[int](), list[str]()
    for element in description.document(path).iter("link"):
        link = element.get("name", "")
        if link not in placed:
            continue
        number, pose = placed[link]
        for count, collision in enumerate(element.findall("collision")):
            frame = pose @ _origin(collision.find("origin"), link)
            start, end, radius = _enclosing(collision, link, folder)
            starts.append(frame[:3, :3] @ start + frame[:3, 3])
            ends.append(frame[:3, :3] @ end + frame[:3, 3])
            radii.append(radius)
            links.append(number)
            names.append(link if count == 0 else f"{link}_{count + 1}")
    if not links:
        raise ValueError("path: expected links with collision geometry, got none on the chain")
    return CollisionModel.from_capsules(
        np.array(starts), np.array(ends), np.array(radii), links, names=names
    )


def _placed(model: Any, chain: list[Any]) -> dict[str, tuple[int, np.ndarray]]:
    """For each link the number of joints of the chain that move it, and its pose at q = 0."""
    on_chain = {joint.name for joint in chain}
    placed = {chain[0].parent: (0, np.eye(4))}
    rest = list(model.joints)
    while True:
        # Links of a tree in whatever order its joints stand.
        ready = [joint for joint in rest if joint.parent in placed]
        if not ready:
            return placed
        for joint in ready:
            number, pose = placed[joint.parent]
            moves = joint.name in on_chain and joint.type != "fixed"
            origin = np.eye(4) if joint.origin is None else joint.origin
            placed[joint.child] = number + moves, pose @ origin
            rest.remove(joint)


def _origin(element: Element | None, link: str) -> np.ndarray:
    if element is None:
        return np.eye(4)
    xyz, rpy = (_numbers(element, name, 3, link, "0 0 0") for name in ("xyz", "rpy"))
    return pose_from_rpy([*xyz, *rpy])


def _numbers(
    element: Element, name: str, count: int, link: str, default: str | None = None
) -> np.ndarray:
    text = element.get(name, default)
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.array([])
    if values.shape != (count,) or not np.all(np.isfinite(values)):
        raise ValueError(
            f"path: link {link!r}, <{element.tag}> {name}: expected {count} finite numbers, "
            f"got {text!r}"
        )
    return values


def _enclosing(collision: Element, link: str, folder: Path | None) -> _Capsule:
    geometry = collision.find("geometry")
    shapes = [] if geometry is None else list(geometry)
    readers: dict[str, Callable[[Element], _Capsule]] = {
        "sphere": lambda x: _along(2, 0.0, _numbers(x, "radius", 1, link)[0]),
        "cylinder": lambda x: _along(
            2, _numbers(x, "length", 1, link)[0] / 2, _numbers(x, "radius", 1, link)[0]
        ),
        "capsule": lambda x: _along(
            2, _numbers(x, "length", 1, link)[0] / 2, _numbers(x, "radius", 1, link)[0]
        ),
        "box": lambda x: _of_box(_numbers(x, "size", 3, link) / 2),
        "mesh": lambda x: enclosing_capsule(_vertices(x, link, folder)),
    }
    if len(shapes) != 1 or shapes[0].tag not in readers:
        found = ", ".join(shape.tag for shape in shapes) or "nothing"
        raise ValueError(
            f"path: link {link!r}, <geometry>: expected one of {', '.join(readers)}, got {found}"
        )
    return readers[shapes[0].tag](shapes[0])


def _along(axis: int, half: float, radius: float) -> _Capsule:
    end = half * np.eye(3)[axis]
    return -end, end, float(radius)


def _of_box(half: np.ndarray) -> _Capsule:
    axis = int(np.argmax(half))
    return _along(axis, half[axis], float(np.linalg.norm(np.delete(half, axis))))


def enclosing_capsule(points: np.ndarray) -> _Capsule:
    """A capsule around points (k, 3), along their principal axis: start, end and radius.

    It is the shortest of its radius on its line, and not the smallest of all.
    """
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    axis = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
    apart = points - middle
    along = apart @ axis
    across = apart - along[:, None] * axis
    # The line through the middle of what is across it.
    sides = np.linalg.svd(axis[None])[2][1:]
    flat = across @ sides.T
    centre = (flat.min(axis=0) + flat.max(axis=0)) / 2
    squares = np.sum((flat - centre) ** 2, axis=1)
    radius = float(np.sqrt(squares.max()))
    reach = np.sqrt(np.maximum(radius**2 - squares, 0.0))
    low, high = np.min(along + reach), np.max(along - reach)
    if low > high:
        low = high = (low + high) / 2
    origin = middle + centre @ sides
    return origin + low * axis, origin + high * axis, radius


def _vertices(mesh: Element, link: str, folder: Path | None) -> np.ndarray:
    name = mesh.get("filename") or ""
    try:
        trimesh = importlib.import_module("trimesh")
    except ImportError as error:
        raise ImportError(
            'meshes need trimesh; install it with: pip install "niryo_jax[urdf]"'
        ) from error
    found = trimesh.load(_mesh_file(name, link, folder), force="mesh")
    scale = _numbers(mesh, "scale", 3, link, "1 1 1")
    return np.asarray(found.vertices, float) * scale


def _mesh_file(name: str, link: str, folder: Path | None) -> Path:
    """The file of a mesh, for `package://` below any of the folders above the description."""
    relative = name.removeprefix("file://")
    if name.startswith("package://"):
        relative = name.removeprefix("package://")
    places = [Path(relative)] if folder is None else [folder / relative]
    if folder is not None and name.startswith("package://"):
        inside = Path(*Path(relative).parts[1:])
        places += [
            above / part for above in (folder, *folder.parents) for part in (relative, inside)
        ]
    for place in places:
        if place.is_file():
            return place
    raise FileNotFoundError(f"path: link {link!r}: no mesh file {name!r} was found")
