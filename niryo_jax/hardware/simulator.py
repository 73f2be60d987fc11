"""A simulated Niryo: a TCP server on this machine that speaks the robot's protocol."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from types import TracebackType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from niryo_jax.hardware.faults import Fault, FaultPlan
from niryo_jax.hardware.protocol import Request
from niryo_jax.hardware.simulated.arm import SimulatedArm
from niryo_jax.hardware.simulated.server import Server
from niryo_jax.hardware.simulated.wear import Wear
from niryo_jax.robots import NIRYO_ONE, NiryoModel


class SimulatedNiryo:
    """A Niryo that exists in this process only; use it in a `with` statement.

    It answers as the robot's own server does, behind which the arm reaches every pose that complete
    inverse kinematics finds joints for. It serves one client at a time: a second one is accepted by
    the operating system and served after the first has left. Losing the client does not stop the
    arm, and the answer to its move goes to the client that is connected when the arm arrives.

    Args:
        model: which arm.
        host: address to listen on.
        port: port to listen on; 0 chooses a free one. The robot's own is 40001.
        time_scale: how many times faster than the robot the arm moves.
        faults: faults to show from the start.
        version: the robot's system: "4.1.1", or "5.6.3", which answers OK to moves it refuses.
        tool: the tool mounted on the arm, detected on UPDATE_TOOL; one of `model.tools`.
        wear: by how much its joints stand elsewhere than its encoders say; by nothing if not given.

    Attributes:
        arm: the simulated arm: joints, tool and things.
        host, port: where the server listens.
        version: the robot's system.

    Raises:
        ValueError: a time scale that is not positive, an unknown version or tool.
        OSError: the port is taken.
    """

    def __init__(
        self,
        model: NiryoModel = NIRYO_ONE,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        time_scale: float = 1.0,
        faults: Iterable[Fault] = (),
        version: Literal["4.1.1", "5.6.3"] = "4.1.1",
        tool: str = "gripper_1",
        wear: Wear | None = None,
    ) -> None:
        if not time_scale > 0:
            raise ValueError(f"time_scale: expected a positive number, got {time_scale!r}")
        if version not in ("4.1.1", "5.6.3"):
            raise ValueError(f'version: expected "4.1.1" or "5.6.3", got {version!r}')
        if tool not in model.tools:
            known = ", ".join(model.tools)
            raise ValueError(f"tool: expected one of {known} for {model.name}, got {tool!r}")
        self.arm = SimulatedArm(
            model, time_scale=time_scale, mounted_tool=tool, wear=wear or Wear()
        )
        self.version = version
        self._faults = FaultPlan(faults)
        self._server = Server(
            self.arm, modern=version == "5.6.3", host=host, port=port, faults=self._faults
        )
        self.host, self.port = self._server.address
        self._thread = threading.Thread(
            target=self._server.run, name=f"simulated-niryo-reader-{self.port}", daemon=True
        )
        self._thread.start()

    @property
    def address(self) -> str:
        """host:port, as `NiryoArm` takes it."""
        return f"{self.host}:{self.port}"

    @property
    def received(self) -> tuple[Request, ...]:
        """The requests that came so far, in order."""
        return tuple(self._server.received)

    def place_object(self, position: Sequence[float]) -> None:
        """Put the object to be gripped at a position (3,) in the space frame, metres."""
        pose = np.eye(4)
        pose[:3, 3] = position
        self.arm.place_things([pose], (0.0, 0.0, 0.0))

    def place_blocks(self, poses: ArrayLike, size: Sequence[float]) -> None:
        """Put blocks there, in the place of all before.

        Args:
            poses: (k, 4, 4) of the middles of their bases in the space frame, metres, upright.
            size: (3,) of each, metres along its axes.
        """
        self.arm.place_things(poses, size)

    @property
    def blocks(self) -> NDArray[np.float64]:
        """(k, 4, 4) where they are now, in the order in which they were placed."""
        return self.arm.things

    @property
    def true_pose(self) -> NDArray[np.float64]:
        """(4, 4) pose of the tool frame, where a perfect instrument sees it; the arm reports the
        one that its encoders say."""
        return self.arm.true_pose

    @property
    def object_position(self) -> NDArray[np.float64] | None:
        """(3,) position of the object in the space frame, metres; None before one is placed."""
        things = self.arm.things
        return things[0, :3, 3] if len(things) else None

    def inject(self, fault: Fault) -> None:
        """Let a fault show from the next request on."""
        self._faults.add(fault)

    def clear_faults(self) -> None:
        """Forget all faults."""
        self._faults.clear()

    def close(self) -> None:
        """Stop serving: every connection is closed and the server's threads have ended."""
        self._server.stop()
        self._thread.join()

    def __enter__(self) -> SimulatedNiryo:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
