"""Arms as nodes of a scene, of which poses and colours change and meshes do not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from niryo_jax.viewer.colours import Colour
from niryo_jax.viewer.geometry import Mesh, places, shrunk

if TYPE_CHECKING:
    import viser


class SolidArm:
    """One arm: a node for each link.

    Args:
        scene: that it is part of.
        name: of its node.
        meshes: by the number of joints that move them, space frame at q = 0.
        colours: of the links, in turn.
        opacity: None where nothing shines through.
        visible: whether it is seen at first.
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        meshes: Mapping[int, Mesh],
        colours: tuple[Colour, ...],
        opacity: float | None = None,
        visible: bool = True,
    ) -> None:
        self._node = scene.add_frame(name, show_axes=False, visible=visible)
        self._links = {
            link: scene.add_mesh_simple(
                f"{name}/link_{link}",
                mesh.vertices,
                mesh.faces,
                color=colours[index % len(colours)],
                opacity=opacity,
                side="front",
                cast_shadow=opacity is None,
                receive_shadow=False,
            )
            for index, (link, mesh) in enumerate(sorted(meshes.items()))
        }

    @property
    def visible(self) -> bool:
        """Whether it is seen."""
        return self._node.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self._node.visible = visible

    def move(self, links: np.ndarray) -> None:
        """Put the links, (n + 1, 4, 4), where they have moved from their home places."""
        wxyz, position = places(links)
        for link, node in self._links.items():
            node.wxyz, node.position = wxyz[link], position[link]

    def paint(self, colour: Colour) -> None:
        """Give all links a colour."""
        for node in self._links.values():
            node.color = colour


class Ghosts:
    """Many arms that shine through: a node for each link, with an instance for each arm.

    Args:
        scene: that they are part of.
        name: of their node.
        meshes: as of a `SolidArm`.
        inset: metres by which they are thinner, so that they do not shine through where they
            coincide with an arm.
        count: how many arms there are at most.
        on_click: called with the number of an arm that was clicked.
    """

    OPACITY = 0.4

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        meshes: Mapping[int, Mesh],
        inset: float,
        count: int,
        on_click: Callable[[int], None],
    ) -> None:
        self._node = scene.add_frame(name, show_axes=False)
        self._links: dict[int, viser.BatchedMeshHandle] = {}
        for link, mesh in meshes.items():
            if link == 0:  # The base is that of the arm itself, which stands there.
                continue
            mesh = shrunk(mesh, inset)
            node = scene.add_batched_meshes_simple(
                f"{name}/link_{link}",
                mesh.vertices,
                mesh.faces,
                batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
                batched_positions=np.zeros((count, 3)),
                batched_scales=np.zeros(count),
                batched_colors=np.zeros((count, 3), np.uint8),
                opacity=self.OPACITY,
                lod="off",
                cast_shadow=False,
                receive_shadow=False,
            )
            node.on_click(lambda event: on_click(event.instance_index or 0))
            self._links[link] = node

    @property
    def visible(self) -> bool:
        """Whether they are seen."""
        return self._node.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self._node.visible = visible

    def move(self, links: np.ndarray, shown: NDArray[np.bool_], colours: NDArray[np.uint8]) -> None:
        """Put the arms somewhere.

        Args:
            links: (count, n + 1, 4, 4) how their links have moved from their home places.
            shown: (count,) which of them are to be seen.
            colours: (count, 3) of each.
        """
        wxyz, position = places(links)
        for link, node in self._links.items():
            node.batched_wxyzs = wxyz[:, link].astype(np.float32)
            node.batched_positions = position[:, link].astype(np.float32)
            # Sent where it differs from before.
            node.batched_scales = shown.astype(np.float32)
            node.batched_colors = colours
