"""Triangles of capsules and ellipsoids, and poses as a scene takes them; all of numpy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from niryo_jax.workspace.orientations import quaternions_of, rotations_of

_AROUND, _UP = 20, 5
"""Points of a ring, and rings of a half sphere from its pole to its equator."""


class Mesh(NamedTuple):
    """Triangles.

    Attributes:
        vertices: (v, 3) metres.
        faces: (f, 3) indices of vertices, counter-clockwise as seen from outside.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]


class Places(NamedTuple):
    """Rigid motions as quaternions and positions.

    Attributes:
        wxyz: (..., 4) unit quaternions (w, x, y, z), w >= 0.
        position: (..., 3) metres.
    """

    wxyz: NDArray[np.float64]
    position: NDArray[np.float64]


def places(poses: np.ndarray) -> Places:
    """(..., 4, 4) poses as quaternions and positions."""
    flat = poses.reshape(-1, 4, 4)
    wxyz = quaternions_of(flat[:, :3, :3]).reshape(*poses.shape[:-2], 4)
    return Places(wxyz, poses[..., :3, 3])


def pose_of(wxyz: np.ndarray, position: np.ndarray) -> NDArray[np.float64]:
    """(4, 4) the pose of a quaternion (w, x, y, z), of any length but 0, and a position."""
    pose = np.eye(4)
    turn = np.asarray(wxyz, np.float64)
    pose[:3, :3] = rotations_of(turn / np.linalg.norm(turn))
    pose[:3, 3] = position
    return pose


def capsule(start: np.ndarray, end: np.ndarray, radius: float) -> Mesh:
    """All points within a radius of a segment, ends (3,); a sphere where the ends coincide."""
    along = np.asarray(end, float) - start
    length = np.linalg.norm(along)
    axis = along / length if length else np.array([0.0, 0.0, 1.0])
    across = np.eye(3)[np.argmin(np.abs(axis))]
    first = np.cross(axis, across)
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    # Two half spheres whose equators are the ends of the cylinder between them.
    rise = np.linspace(0.0, np.pi / 2, _UP + 1)
    height = np.concatenate([-rise[::-1], rise])[:, None]
    turn = np.linspace(0.0, 2 * np.pi, _AROUND, endpoint=False)
    outward = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    centre = np.where(height[..., None] > 0, end, start)
    centre[_UP + 1 :] = end
    rings = centre + radius * (
        np.cos(height)[..., None] * outward + np.sin(height)[..., None] * axis
    )
    return Mesh(rings.reshape(-1, 3).astype(np.float32), _between_rings(len(height)))


def _between_rings(rings: int) -> NDArray[np.uint32]:
    """(f, 3) the triangles between rings that follow each other."""
    point = np.arange(_AROUND)
    following = (point + 1) % _AROUND
    base = np.arange(rings - 1)[:, None] * _AROUND
    a, b = base + point, base + following
    c, d = a + _AROUND, b + _AROUND
    faces = np.concatenate([np.stack([a, b, d], -1), np.stack([a, d, c], -1)])
    return faces.reshape(-1, 3).astype(np.uint32)


def unit_sphere() -> Mesh:
    """A sphere of radius 1 about the origin."""
    return capsule(np.zeros(3), np.zeros(3), 1.0)


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """Meshes, of which there is one at least, as one."""
    before = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + at for mesh, at in zip(meshes, before)]).astype(np.uint32),
    )


def shrunk(mesh: Mesh, by: float) -> Mesh:
    """A mesh whose vertices lie deeper by so many metres."""
    corners = mesh.vertices[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = np.zeros_like(mesh.vertices)
    for corner in mesh.faces.T:
        np.add.at(outward, corner, normal)
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    unit = outward / np.where(length > 0, length, 1.0)
    return mesh._replace(vertices=(mesh.vertices - by * unit).astype(np.float32))


def ellipsoid(matrix: np.ndarray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What makes of the unit sphere the ellipsoid x^T matrix^-1 x <= 1.

    Args:
        matrix: (3, 3) symmetric and positive semidefinite.

    Returns:
        (4,) the quaternion (w, x, y, z) of its axes and (3,) its half axes.
    """
    values, axes = np.linalg.eigh(matrix)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return quaternions_of(axes[None])[0], np.sqrt(np.maximum(values, 0.0))
