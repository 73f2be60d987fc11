"""How fast solutions follow the gizmo of the viewer, in the process and through a websocket.

    python -m benchmarks.viewer [--moves 300] [--save]

In the process: from the event of the gizmo to the messages of the scene. Through a websocket: a
client of this process takes the part of a browser, sends one pose after the other, each when the
ghosts of the one before have arrived, and then 60 a second. No browser draws anything. The exit
code is 1 where a ghost that was sent misses its target.
"""

from __future__ import annotations

import argparse
import importlib
import time
from typing import Any

import jax
import numpy as np

from benchmarks import reference
from benchmarks.measure import Claim, Report, about, header, table
from niryo_jax.robots import catalogue
from niryo_jax.viewer import Viewer
from niryo_jax.viewer.geometry import places, pose_of

AIM = 20.0
"""Updates a second that a hand sees as one movement."""

PACE = 60.0
"""Events a second of a gizmo, which a browser sends at most as often as it draws."""

RIGHT = 2e-6
"""How far a ghost may be from its target, metres: poses are sent in float32."""

ARMS = "niryo_one", "ur16e", "kuka_iiwa14"


class Client:
    """A browser that draws nothing.

    Args:
        viewer: whose page it opens.
    """

    def __init__(self, viewer: Viewer) -> None:
        viser = importlib.import_module("viser")
        client = importlib.import_module("websockets.sync.client")
        self._msgpack = importlib.import_module("msgspec").msgpack
        self._zstd = importlib.import_module("zstandard")
        self._socket = client.connect(
            viewer.url.replace("http", "ws"),
            subprotocols=[f"viser-v{viser.__version__}"],
            max_size=None,
        )
        self.link = f"/solutions/link_{max(viewer.session.shape.meshes)}"

    def drag(self, pose: np.ndarray) -> None:
        """Tell that the gizmo has been dragged to a pose."""
        (wxyz,), (position,) = places(pose[None])
        self._socket.send(
            self._msgpack.encode(
                {
                    "type": "TransformControlsUpdateMessage",
                    "name": "/target",
                    "wxyz": wxyz.tolist(),
                    "position": position.tolist(),
                    "owner": "",
                }
            )
        )

    def ghosts(self, timeout: float) -> dict[str, np.ndarray] | None:
        """What the next message that moves the last link of the ghosts says; None if none came."""
        end = time.perf_counter() + timeout
        while (left := end - time.perf_counter()) > 0:
            try:
                found = self._ghosts_of(self._socket.recv(timeout=left))
            except TimeoutError:
                return None
            if "batched_positions" in found:
                return found
        return None

    def _ghosts_of(self, raw: bytes) -> dict[str, np.ndarray]:
        size = int.from_bytes(raw[8:16], "little")
        window = self._msgpack.decode(self._zstd.decompress(raw[16 : 16 + size]))
        parts, at = list[bytes](), 16 + size
        for length in window["binaryBufferLengths"]:
            at += -at % 8
            parts.append(raw[at : at + length])
            at += length
        found = dict[str, np.ndarray]()
        for message in window["messages"]:
            if message["type"] == "SceneNodeUpdateMessage" and message["name"] == self.link:
                for name, value in message["updates"].items():
                    if isinstance(value, dict):
                        index = value["__binary_index"]
                        found[name] = np.frombuffer(parts[index], np.float32)
        return found

    def close(self) -> None:
        """Close the tab."""
        self._socket.close()


def swing(start: np.ndarray, moves: int) -> np.ndarray:
    """(moves, 4, 4) poses about a pose, one near the other, as a hand drags them."""
    phase = np.linspace(0.0, 6 * np.pi, moves)
    poses = np.tile(start, (moves, 1, 1))
    poses[:, 0, 3] += 0.03 * np.sin(phase)
    poses[:, 2, 3] += 0.02 * np.sin(2.3 * phase)
    return poses


def in_process(viewer: Viewer, poses: np.ndarray) -> list[float]:
    """Seconds from each event until its messages are queued and the next can be taken."""
    spent = list[float]()
    for pose in poses:
        begin = time.perf_counter()
        viewer.drag(pose)
        viewer.settle()
        spent.append(time.perf_counter() - begin)
    return spent


def through_a_socket(
    viewer: Viewer, client: Client, poses: np.ndarray, report: Report
) -> list[float]:
    """Seconds from each event until its ghosts have arrived."""
    spent, worst = list[float](), 0.0
    for pose in poses:
        begin = time.perf_counter()
        client.drag(pose)
        sent = client.ghosts(10.0)
        spent.append(time.perf_counter() - begin)
        if sent is None:
            report.wrong.append(f"{viewer.session.robot.name}: no ghosts arrived in 10 s")
            break
        worst = max(worst, miss(viewer, pose, sent))
    if not worst < RIGHT:
        name = viewer.session.robot.name
        report.wrong.append(f"{name}: a ghost that was sent misses its target by {worst:.1e}")
    return spent


def miss(viewer: Viewer, pose: np.ndarray, sent: dict[str, np.ndarray]) -> float:
    """How far the ghosts of solutions, as they were sent, and the arm, are from a target."""
    robot, found = viewer.session.robot, viewer.view.found
    home = np.asarray(robot.home)
    wxyz = sent.get("batched_wxyzs", np.zeros(0)).reshape(-1, 4)
    position = sent["batched_positions"].reshape(-1, 3)
    tools = [
        pose_of(wxyz[slot], position[slot]) @ home for slot in np.flatnonzero(found) if len(wxyz)
    ]
    tools.append(reference.forward_kinematics(robot, viewer.view.q[None])[0])
    return float(np.max(np.abs(np.array(tools) - pose)))


def streamed(client: Client, poses: np.ndarray) -> float:
    """Updates a second that arrive while the gizmo sends its events at its own pace."""
    while client.ghosts(0.3) is not None:
        pass
    arrived, begin = 0, time.perf_counter()
    for number, pose in enumerate(poses):
        client.drag(pose)
        due = begin + (number + 1) / PACE
        while (left := due - time.perf_counter()) > 0:
            arrived += client.ghosts(left) is not None
    return arrived / (time.perf_counter() - begin)


def measure(name: str, moves: int, report: Report) -> tuple[list[str], list[Claim]]:
    """A row of the table, and the claims of an arm."""
    with Viewer(catalogue.load(name), port=0) as viewer:
        poses = swing(viewer.view.target, moves)
        in_process(viewer, poses[:5])
        own = np.array(in_process(viewer, poses))
        client = Client(viewer)
        client.ghosts(2.0)
        far = np.array(through_a_socket(viewer, client, poses, report))
        rate = streamed(client, poses)
        client.close()
    ms = [1e3 * float(np.quantile(x, share)) for x in (own, far) for share in (0.5, 0.99)]
    report.data[name] = {"in_process": own.tolist(), "socket": far.tolist(), "streamed": rate}
    claims = [
        Claim(
            f"{name}: {1e3 / ms[1]:.0f} updates a second in the process in 99 of 100 "
            f"moves, of {AIM:.0f}",
            1e3 / ms[1] >= AIM,
        ),
        Claim(
            f"{name}: {rate:.0f} updates a second at a client whose gizmo sends {PACE:.0f}, "
            f"of {AIM:.0f}",
            rate >= AIM,
        ),
    ]
    return [name, *(f"{x:.1f}" for x in ms), f"{rate:.0f}"], claims


def main() -> int:
    """Run, print, and return the exit code."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=300)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    facts: dict[str, Any] = about("viser", moves=options.moves)
    report = Report("The viewer: from the gizmo to the ghosts", facts, [header(facts)])
    rows = list[list[str]]()
    for name in ARMS:
        row, claims = measure(name, options.moves, report)
        rows.append(row)
        report.claims += claims
    head = [
        *("arm", "in the process, median (ms)", "99 % (ms)"),
        *("to a client and back, median (ms)", "99 % (ms)", "updates/s at 60 events/s"),
    ]
    report.sections.append(table(head, rows))
    return report.finish("viewer" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
