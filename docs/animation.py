"""The animation of the README: an arm along a circle, and all other solutions as ghosts.

pip install -e ".[viewer,workspace]"
python -m docs.animation                     # writes docs/niryo-one.webp
python -m docs.animation --still 12 a.png    # one frame

Nothing in it is drawn by hand: the arm is the capsules of `niryo_jax.collision`, its joints are
those of `motion.best_path`, and each ghost is a solution of `inverse_kinematics`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from matplotlib import get_data_path
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import niryo_jax as nj
from niryo_jax import collision
from niryo_jax.viewer.colours import LINKS, OUTSIDE, PATH, of_branch

Array = NDArray[np.float64]

OUTPUT = Path(__file__).parent / "niryo-one.webp"
WIDTH, HEIGHT, FINER = 760, 500, 2
FRAMES, SECONDS = 108, 6.0
METRES_HIGH = 0.82
"""What the height of a frame shows, where it is looked at."""
LOOKED_AT = np.array([-0.14, -0.05, 0.325])
AZIMUTH, ELEVATION = np.radians(-68.0), np.radians(17.0)

LIGHT = np.array([0.35, -0.45, 0.82]) / np.linalg.norm([0.35, -0.45, 0.82])
PAPER, LINE = np.array([250.0, 251.0, 252.0]), np.array([222.0, 226.0, 230.0])
WITHIN_ALPHA, OUTSIDE_ALPHA = 0.5, 0.22
MIDDLE, RADIUS = np.array([0.64, 0.17, 0.62, 1.71, 1.2, 2.29]), 0.08
"""The joints at which the tool is in the middle of its circle, and metres."""


class Capsules(NamedTuple):
    """Capsules as the camera sees them: right, up, and towards it.

    Attributes:
        start, end: (k, 3) metres.
        radius: (k,) metres.
        colour: (k, 3) from 0 to 255.
    """

    start: Array
    end: Array
    radius: Array
    colour: Array


class Layer(NamedTuple):
    """What is seen of some capsules.

    Attributes:
        depth: (height, width) metres towards the camera; minus infinity where there is nothing.
        colour: (height, width, 3) shaded, from 0 to 255.
    """

    depth: Array
    colour: Array


class Motion(NamedTuple):
    """A closed path of the tool.

    Attributes:
        q: (frames, n) the joints of the arm.
        solutions: all solutions of each frame.
        tool: (frames, 3) where the tool frame is, metres.
    """

    q: Array
    solutions: nj.IKSolutions
    tool: Array


def motion(robot: nj.Robot, frames: int) -> Motion:
    """A level circle above the arm with a tool that keeps its direction, on the best branch."""
    turn = np.linspace(0.0, 2 * np.pi, frames, endpoint=False)
    poses = np.tile(np.asarray(nj.forward_kinematics(robot, MIDDLE)), (frames, 1, 1))
    poses[:, 0, 3] += RADIUS * np.cos(turn)
    poses[:, 1, 3] += RADIUS * np.sin(turn)
    best = nj.motion.best_path(robot, np.concatenate([poses, poses[:1]]), closed=True)
    if not best.ok:
        raise ValueError(best.message)
    solutions = jax.tree.map(np.asarray, nj.inverse_kinematics(robot, poses))
    return Motion(best.q[:-1], solutions, poses[:, :3, 3])


def camera() -> Array:
    """(3, 3) rows: right, up, and towards the camera, in the space frame."""
    a, e = AZIMUTH, ELEVATION
    towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


VIEW = camera()


def pixels() -> tuple[Array, Array]:
    """(width,) metres to the right and (height,) up of the middles of pixels."""
    size = METRES_HIGH / (HEIGHT * FINER)
    across = (np.arange(WIDTH * FINER) + 0.5 - WIDTH * FINER / 2) * size
    up = (HEIGHT * FINER / 2 - 0.5 - np.arange(HEIGHT * FINER)) * size
    return across, up


def posed(robot: nj.Robot, model: collision.CollisionModel, q: Array, colours: Array) -> Capsules:
    """The capsules of an arm at joints q; colours (k, 3)."""
    links = np.concatenate([np.eye(4)[None], np.asarray(nj.link_poses(robot, q))])
    motion_of = links[np.asarray(model.links)]
    ends = (
        np.einsum("kij,kj->ki", motion_of[:, :3, :3], np.asarray(end)) + motion_of[:, :3, 3]
        for end in (model.start, model.end)
    )
    start, end = ((point - LOOKED_AT) @ VIEW.T for point in ends)
    # Neighbours differ a little, so that of two round ends in one place one is seen.
    radius = np.asarray(model.radius) - 0.001 * (np.arange(len(colours)) % 2)
    return Capsules(start, end, radius, colours)


def rendered(capsules: Capsules) -> Layer:
    """The nearest surfaces, by the roots of each capsule's quadratic along the line of sight."""
    across, up = pixels()
    depth = np.full((len(up), len(across)), -np.inf)
    colour = np.zeros((*depth.shape, 3))
    light = VIEW @ LIGHT
    halfway = np.add(light, np.array([0.0, 0.0, 1.0])) / 1.9
    for start, end, radius, paint in zip(*capsules):
        low, high = np.minimum(start, end) - radius, np.maximum(start, end) + radius
        columns = slice(*np.searchsorted(across, (low[0], high[0])))
        rows = slice(*np.searchsorted(-up, (-high[1], -low[1])))
        x, y = across[None, columns] - start[0], up[rows, None] - start[1]
        length = np.linalg.norm(end - start)
        axis = (end - start) / length if length else np.array([0.0, 0.0, 0.0])
        flat = x * axis[0] + y * axis[1]
        square, fall = x * x + y * y, 1.0 - axis[2] ** 2
        with np.errstate(invalid="ignore", divide="ignore"):
            inside = (flat * axis[2]) ** 2 - fall * (square - flat**2 - radius**2)
            z = (flat * axis[2] + np.sqrt(inside)) / fall
            along = flat + z * axis[2]
            z = np.where((along >= 0) & (along <= length), z, -np.inf)
            far = (x - (end - start)[0]) ** 2 + (y - (end - start)[1]) ** 2
            for ball, bottom in ((square, 0.0), (far, (end - start)[2])):
                z = np.fmax(z, bottom + np.sqrt(radius**2 - ball))
        z = np.where(np.isfinite(z), z, -np.inf)
        nearer = z + start[2] > depth[rows, columns]
        with np.errstate(invalid="ignore"):
            along = np.clip(flat + z * axis[2], 0.0, length)
            normal = np.stack(np.broadcast_arrays(x, y, z), -1) - along[..., None] * axis
            normal /= radius
            shade = 0.62 + 0.42 * np.clip(normal @ light, -0.6, 1.0)
            shade -= 0.22 * (1.0 - np.clip(normal[..., 2], 0, 1)) ** 3
            gloss = 36.0 * np.clip(normal @ halfway, 0.0, 1.0) ** 30
            shaded = np.clip(paint * shade[..., None] + gloss[..., None], 0, 255)
        depth[rows, columns] = np.where(nearer, z + start[2], depth[rows, columns])
        colour[rows, columns] = np.where(nearer[..., None], shaded, colour[rows, columns])
    return Layer(depth, colour)


def ground() -> tuple[Layer, Array]:
    """The floor z = 0 with its grid, and (height, width, 3) which of its points are seen."""
    across, up = pixels()
    right, above, towards = VIEW
    origin = LOOKED_AT + across[None, :, None] * right + up[:, None, None] * above
    height = -origin[..., 2] / towards[2]
    point = origin + height[..., None] * towards
    away = np.linalg.norm(point[..., :2], axis=-1)
    pixel = METRES_HIGH / (HEIGHT * FINER)
    cell = np.abs((point[..., :2] / 0.1 + 0.5) % 1.0 - 0.5) * 0.1
    widths = pixel * np.array([0.9, 0.9 / np.sin(ELEVATION)])
    line = np.max(np.clip(1.6 - cell / widths, 0.0, 1.0), axis=-1) * np.exp(-((away / 0.55) ** 4))
    colour = PAPER + (LINE - PAPER) * line[..., None]
    return Layer(height, colour), point


def shadow(capsules: Capsules, point: Array) -> Array:
    """(height, width) from 0 to 1: how much of the light the capsules keep from the floor."""
    first = np.cross(LIGHT, [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    basis = np.stack([first, np.cross(LIGHT, first)])
    seen = point @ basis.T
    dark = np.zeros(point.shape[:2])
    for start, end, radius in zip(*capsules[:3]):
        ends = (basis @ (VIEW.T @ each + LOOKED_AT) for each in (start, end))
        a, b = ends
        step = b - a
        share = np.clip((seen - a) @ step / max(step @ step, 1e-12), 0.0, 1.0)
        apart = np.linalg.norm(seen - a - share[..., None] * step, axis=-1) - radius
        dark = np.maximum(dark, np.clip(0.5 - apart / 0.03, 0.0, 1.0))
    return dark * dark * (3.0 - 2.0 * dark)


class Stage:
    """All that does not change from frame to frame."""

    def __init__(self, frames: int) -> None:
        self.robot = nj.robots.niryo_one()
        self.model = collision.niryo_one("gripper_1")
        self.motion = motion(self.robot, frames)
        self.floor, self.point = ground()
        self.colours = np.array(
            [LINKS[(part + 1) % 2] for part in range(len(self.model.links))], float
        )
        tool = (self.motion.tool - LOOKED_AT) @ VIEW.T
        ring = np.tile(np.array(PATH, float), (frames, 1))
        self.ring = Capsules(tool, np.roll(tool, -1, axis=0), np.full(frames, 0.0022), ring)

    def ghosts(self, frame: int) -> list[tuple[Capsules, float]]:
        """The other solutions, and how dense each is."""
        solutions = self.motion.solutions
        found = []
        for slot in np.flatnonzero(solutions.found[frame]):
            q = solutions.q[frame, slot]
            if np.all(np.abs(np.remainder(q - self.motion.q[frame] + 3, 2 * np.pi) - 3) < 1e-3):
                continue
            within = bool(solutions.within_limits[frame, slot])
            colour = of_branch(int(solutions.label[frame, slot])) if within else OUTSIDE
            paint = np.tile(np.array(colour, float), (len(self.model.links), 1))
            alpha = WITHIN_ALPHA if within else OUTSIDE_ALPHA
            found.append((posed(self.robot, self.model, q, paint), alpha))
        return found

    def frame(self, frame: int) -> Image.Image:
        """One frame of the animation."""
        arm = posed(self.robot, self.model, self.motion.q[frame], self.colours)
        colour = self.floor.colour * (1.0 - 0.16 * shadow(arm, self.point))[..., None]
        depth = self.floor.depth
        for capsules in (self.ring, arm):
            layer = rendered(capsules)
            nearer = layer.depth > depth
            colour = np.where(nearer[..., None], layer.colour, colour)
            depth = np.where(nearer, layer.depth, depth)
        # Ghosts from the back to the front; what lies within the arm's skin is not seen.
        layers = [(rendered(ghost), alpha) for ghost, alpha in self.ghosts(frame)]
        layers.sort(key=lambda pair: float(np.median(pair[0].depth[np.isfinite(pair[0].depth)])))
        for layer, alpha in layers:
            shown = alpha * np.clip((layer.depth - depth - 0.004) / 0.004, 0.0, 1.0)
            colour = colour + shown[..., None] * (layer.colour - colour)
        image = Image.fromarray(np.clip(colour + 0.5, 0, 255).astype(np.uint8))
        image = image.resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)
        self._write(image, frame)
        return image

    def _write(self, image: Image.Image, frame: int) -> None:
        solutions = self.motion.solutions
        found, within = (int(x[frame].sum()) for x in (solutions.found, solutions.within_limits))
        draw = ImageDraw.Draw(image)
        large, plain = font("DejaVuSans-Bold", 30), font("DejaVuSans", 15)
        draw.text((24, 18), f"{found} solutions", (34, 38, 46), large)
        draw.text((24, 58), f"{within} within the joint limits", (70, 76, 86), plain)
        if solutions.complete[frame]:
            draw.text((24, 80), "proved: there are no others", (70, 76, 86), plain)
        rows = (
            (LINKS, "the solution that is taken"),
            (
                [
                    of_branch(int(label))
                    for label in np.unique(solutions.label[solutions.within_limits])
                ],
                "others within the limits, by branch",
            ),
            ([OUTSIDE], "outside the limits"),
        )
        top = HEIGHT - 26 * len(rows) - 8
        for row, (colours, words) in enumerate(rows):
            y, x = top + 26 * row, 24
            for colour in colours:
                draw.rounded_rectangle((x, y + 3, x + 12, y + 15), 4, colour)
                x += 15
            draw.text((x + 5, y), words, (70, 76, 86), plain)


def font(name: str, size: int) -> ImageFont.FreeTypeFont:
    """A font that comes with matplotlib."""
    return ImageFont.truetype(Path(get_data_path()) / "fonts" / "ttf" / f"{name}.ttf", size)


def main() -> None:
    """Draw the animation, or one frame."""
    parser = argparse.ArgumentParser(prog="python -m docs.animation", description=__doc__)
    parser.add_argument("--still", nargs=2, metavar=("FRAME", "FILE"))
    still = parser.parse_args().still
    jax.config.update("jax_enable_x64", True)
    stage = Stage(FRAMES)
    if still:
        stage.frame(int(still[0])).save(still[1])
        return
    frames = [stage.frame(frame) for frame in range(FRAMES)]
    frames[0].save(
        OUTPUT,
        save_all=True,
        append_images=frames[1:],
        duration=round(1000 * SECONDS / FRAMES),
        loop=0,
        quality=86,
        method=6,
    )
    print(f"{OUTPUT}: {FRAMES} frames, {OUTPUT.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
