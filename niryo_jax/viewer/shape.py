"""What an arm looks like: the meshes of its description, else the capsules of its model."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from niryo_jax import collision
from niryo_jax.collision import CollisionModel, World
from niryo_jax.extras import need
from niryo_jax.robot import Robot
from niryo_jax.robots import MODELS, description
from niryo_jax.viewer.geometry import Mesh, capsule, merged, shrunk

_THIN = 0.03
"""The radius of capsules of an arm of which nothing but its axes is known, as a share of its
reach."""


_STEP = 0.03
"""Between the radii of links that follow each other, drawn, as a share of the largest."""


@dataclasses.dataclass(frozen=True)
class Shape:
    """What is drawn of an arm.

    Attributes:
        meshes: by the number of joints that move them, in the space frame at q = 0, metres.
        model: capsules for clearances; None where there are none that enclose the arm.
        world: what the arm is to keep clear of, with a model.
        reach: metres from the origin of the space frame to the farthest point at q = 0.
    """

    meshes: Mapping[int, Mesh]
    model: CollisionModel | None
    world: World | None
    reach: float

    def capsules(self) -> dict[int, Mesh]:
        """The capsules of the model, as `meshes`; none where there is no model."""
        return {} if self.model is None else _of_capsules(self.model)


def shape_of(
    robot: Robot,
    urdf: str | os.PathLike[str] | None = None,
    base: str | None = None,
    tip: str | None = None,
) -> Shape:
    """The shape of an arm.

    A Niryo is drawn as the capsules of `niryo_jax.collision`. Of a URDF description the visual
    meshes are drawn where all of them can be read, else its collision geometry as capsules; its
    clearances are not told, for which pairs always touch is not known. All others are drawn as thin
    capsules along their axes.

    Args:
        robot: the arm, concrete.
        urdf: the file that it was read from.
        base, tip: the ends of the chain, as for `robots.from_urdf`.

    Raises:
        TypeError: the robot is traced, or no robot.
    """
    if is_niryo(robot):
        model = getattr(collision, robot.name)()
        meshes = _drawn(model)
        # The sphere that stands for the base ends where it stands on the table.
        meshes[0].vertices[:, 2] = np.maximum(meshes[0].vertices[:, 2], 0.0)
        # The shoulder stays where it is, and the upper arm comes no nearer than its two ends.
        return _shape(meshes, model, World.table(ignored=(0, 1, 2)))
    if urdf is not None and (meshes := _of_urdf(urdf, base, tip)):
        return _shape(meshes)
    home = np.asarray(robot.home)[:3, 3]
    reach = max(float(np.linalg.norm(home)), 1e-3)
    try:
        return _shape(_drawn(collision.skeleton(robot, _THIN * reach)))
    except ValueError:
        # All axes meet in one point: there is nothing between them.
        return _shape({robot.joints: capsule(np.zeros(3), home, _THIN * reach)})


def is_niryo(robot: Robot) -> bool:
    """Whether it is one of the Niryo arms as the package brings them."""
    if robot.name not in MODELS:
        return False
    nominal = MODELS[robot.name].robot()
    return all(
        np.array_equal(getattr(robot, part), getattr(nominal, part)) for part in ("screws", "home")
    )


def _shape(
    meshes: dict[int, Mesh], model: CollisionModel | None = None, world: World | None = None
) -> Shape:
    points = np.concatenate([mesh.vertices for mesh in meshes.values()])
    return Shape(meshes, model, world, float(np.max(np.linalg.norm(points, axis=1))))


def _of_capsules(model: CollisionModel) -> dict[int, Mesh]:
    parts = dict[int, list[Mesh]]()
    arrays = (np.asarray(x) for x in (model.start, model.end, model.radius))
    for link, start, end, radius in zip(model.links, *arrays):
        parts.setdefault(link, []).append(capsule(start, end, float(radius)))
    return {link: merged(found) for link, found in parts.items()}


def _drawn(model: CollisionModel) -> dict[int, Mesh]:
    """Capsules of which neighbours differ in radius, so that of two in one place one is seen."""
    meshes = _of_capsules(model)
    return {
        link: shrunk(mesh, _STEP * float(np.max(model.radius)) * (link % 2))
        for link, mesh in meshes.items()
    }


def _of_urdf(
    path: str | os.PathLike[str], base: str | None, tip: str | None
) -> dict[int, Mesh] | None:
    """The visual geometry of a description, else its capsules; None where neither can be read."""
    try:
        return _visuals(path, base, tip)
    # Each reader of meshes refuses a file in its own way.
    except Exception:
        try:
            return _of_capsules(collision.from_urdf(path, base, tip))
        except (ValueError, OSError, ImportError):
            return None


def _visuals(path: str | os.PathLike[str], base: str | None, tip: str | None) -> dict[int, Mesh]:
    yourdfpy = need("yourdfpy", "urdf")
    model: Any = yourdfpy.URDF.load(os.fspath(path), load_collision_meshes=False)
    chain = description.chain(model.robot, base, tip)
    moved = _moved_by(model.robot, chain)
    graph = model.scene.graph
    start = np.linalg.inv(model.get_transform(chain[0].parent))
    parts = dict[int, list[Mesh]]()
    for node in graph.nodes_geometry:
        transform, name = graph[node]
        link = node
        while link not in model.link_map:
            link = graph.transforms.parents[link]
        if link in moved:
            mesh = model.scene.geometry[name].copy()
            mesh.apply_transform(start @ transform)
            vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
            found = Mesh(vertices.astype(np.float32), faces.astype(np.uint32))
            parts.setdefault(moved[link], []).append(found)
    if not parts:
        raise ValueError("no visual geometry can be read")
    return {link: merged(found) for link, found in parts.items()}


def _moved_by(model: Any, chain: list[Any]) -> dict[str, int]:
    """For each link at or below the base the number of joints of the chain that move it."""
    on_chain = {joint.name for joint in chain if joint.type != "fixed"}
    moved = {chain[0].parent: 0}
    rest = list(model.joints)
    while ready := [joint for joint in rest if joint.parent in moved]:
        for joint in ready:
            moved[joint.child] = moved[joint.parent] + (joint.name in on_chain)
            rest.remove(joint)
    return moved
