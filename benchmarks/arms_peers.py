"""Other libraries that return all solutions, for arms of any geometry: how each is handed the arm.

None is a dependency; each is used where it is installed. An adapter takes an arm as its users
would give it, and forward kinematics in numpy checks that it is the same arm. What takes longer to
prepare than `PREPARE` seconds takes no part, and it is said so.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import itertools
import signal
import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import niryo_jax as nj
from benchmarks import singular
from benchmarks.measure import version_of
from benchmarks.peers import Solver, UnsuitedError
from benchmarks.reference import forward_kinematics

PREPARE = 30
"""CPU seconds."""

SAME_ARM = 1e-9
"""Metres and entries of a rotation by which the forward kinematics may differ."""

PARALLEL = 1e-10
"""The sine of an angle below which axes count as parallel when frames are chosen."""


@dataclasses.dataclass(frozen=True)
class Peer(Solver):
    """A library ready to solve one arm.

    Attributes:
        doubted: its answer -> (k, n) joint vectors that it marks as compromises (least squares).
            Next to singular postures some of them are solutions: they count where they close, and
            are not held against it where they do not.
    """

    doubted: Callable[[Any], np.ndarray] | None = None


class TooLong(BaseException):
    """The time is over; no `Exception`, which a library may catch on its way."""


@contextlib.contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """Gives up what is written in Python after so many seconds of CPU.

    Raises:
        TooLong: the time is over.
    """

    if not hasattr(signal, "setitimer"):  # Windows
        yield
        return

    def over(*_: Any) -> None:
        raise TooLong

    before = signal.signal(signal.SIGPROF, over)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def solvers(robot: nj.Robot, skip: tuple[str, ...] = ()) -> tuple[list[Peer], dict[str, str]]:
    """The solvers of the libraries that take the arm, and why the others do not."""
    found, absent = list[Peer](), dict[str, str]()
    for name, (package, build) in PEERS.items():
        if name in skip:
            absent[name] = "skipped"
        elif version_of(package) is None:
            absent[name] = f"not installed (pip install {package})"
        else:
            started = time.perf_counter()
            try:
                with warnings.catch_warnings(), at_most(PREPARE):
                    warnings.simplefilter("ignore")
                    solver = build(robot)
                    _answers_at_all(robot, solver)
            except UnsuitedError as error:
                absent[name] = str(error)
            except TooLong:
                absent[name] = f"not prepared within {PREPARE} s"
            except Exception as error:  # whatever another library raises where it gives up
                reason = (str(error).splitlines() or [""])[0]
                absent[name] = f"refuses: {type(error).__name__}: {reason}"
            else:
                spent = time.perf_counter() - started
                found.append(dataclasses.replace(solver, preparation=spent))
    return found, absent


def _answers_at_all(robot: nj.Robot, solver: Peer) -> None:
    """Some take an arm and then refuse each of its poses: let this one say why."""
    pose = forward_kinematics(robot, np.random.default_rng(1).uniform(-1, 1, (8, robot.joints)))
    for target in pose[:-1]:
        with contextlib.suppress(Exception):
            solver.one(solver.given(target))
            return
    solver.one(solver.given(pose[-1]))


def _same_arm(robot: nj.Robot, forward: Callable[[np.ndarray], np.ndarray]) -> None:
    q = np.random.default_rng(0).uniform(-1, 1, (8, robot.joints))
    theirs = np.array([forward(x) for x in q])
    if not np.max(np.abs(theirs - forward_kinematics(robot, q))) < SAME_ARM:
        raise UnsuitedError("describes another arm")


def _rows(answer: Any, joints: int) -> np.ndarray:
    return np.asarray(answer, dtype=np.float64).reshape(-1, joints)


def axes_and_steps(robot: nj.Robot) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) directions, and (n + 1, 3) from a point of each axis to one of the next, then the
    tool's: the H and P of IK-Geo, at home.

    Axes that meet get the point where they do, which is where ssik looks for it.
    """
    screws, home = np.asarray(robot.screws), np.asarray(robot.home)
    axes, foot = screws[:, :3], np.cross(screws[:, :3], screws[:, 3:])
    points = list[np.ndarray]()
    for i in range(robot.joints):
        meeting = [_meeting(axes, foot, i, j) for j in (i + 1, i - 1) if 0 <= j < robot.joints]
        point = next((x for x in meeting if x is not None), foot[i])
        same = points and np.linalg.norm(point - points[-1]) < SAME_ARM
        points.append(points[-1] if same else point)
    return axes, np.diff([*points, home[:3, 3]], axis=0, prepend=np.zeros((1, 3)))


def _meeting(axes: np.ndarray, point: np.ndarray, i: int, j: int) -> np.ndarray | None:
    """Where axes i and j meet, if they do."""
    between = np.cross(axes[i], axes[j])
    if np.linalg.norm(between) < SAME_ARM:
        return None
    between /= np.linalg.norm(between)
    lines = np.stack([axes[i], -axes[j], between], axis=1)
    along, _, apart = np.linalg.solve(lines, point[j] - point[i])
    return point[i] + axes[i] * along if abs(apart) < SAME_ARM else None


def _ssik(robot: nj.Robot) -> Peer:
    """ssik's own artefact of the arm where it comes with one, or else its class, prepared."""
    import ssik

    turn, spare = np.eye(3), robot.joints > 6
    try:
        solver = ssik.Manipulator.from_prebuilt(robot.name)
        _same_arm(robot, solver.fk)
    except (ValueError, UnsuitedError):
        limits = np.stack(singular.limits(robot), axis=1)
        solver = ssik.Manipulator.from_axes(*axes_and_steps(robot), limits=limits)
        # It takes the tool frame to be parallel to the base frame at home.
        turn = np.asarray(robot.home)[:3, :3]
        solver.prepare()
        _same_arm(robot, lambda q: solver.fk(q) @ _turn(turn))
    back = _turn(turn.T)

    def one(pose: np.ndarray) -> Any:
        return solver.solve(pose, respect_limits=spare)

    def joints(answer: Any) -> np.ndarray:
        return _rows([solution.q for solution in answer], robot.joints)

    return Peer("ssik", one, joints, given=lambda pose: pose @ back)


def _turn(rotation: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = rotation
    return pose


def _eaik(robot: nj.Robot) -> Peer:
    """eaik from the axes, by its batched call with one thread."""
    with contextlib.redirect_stdout(io.StringIO()):
        from eaik.IK_HP import HPRobot

        if robot.joints > 6:
            raise UnsuitedError("arms of up to six joints")
        theirs = HPRobot(*axes_and_steps(robot))
    if not theirs.hasKnownDecomposition():
        raise UnsuitedError(f"refuses: {theirs.getKinematicFamily()}")
    turn = np.asarray(robot.home)[:3, :3]
    back = _turn(turn.T)
    _same_arm(robot, lambda q: theirs.fwdKin(q) @ _turn(turn))

    def joints(answer: Any, doubted: bool = False) -> np.ndarray:
        return _rows(answer.Q, robot.joints)[np.asarray(answer.is_LS, dtype=bool) == doubted]

    def many(poses: list[np.ndarray]) -> Any:
        return theirs.IK_batched(poses, num_worker_threads=1)

    return Peer(
        "eaik",
        theirs.IK,
        joints,
        many,
        given=lambda pose: pose @ back,
        doubted=lambda answer: joints(answer, doubted=True),
    )


def _ikdh(robot: nj.Robot) -> Peer:
    """ikdh from Denavit-Hartenberg parameters."""
    import ikdh

    if robot.joints != 6:
        raise UnsuitedError("arms of six joints")
    base, (a, alpha, d, theta), tool = denavit_hartenberg(robot)
    dh = ikdh.DHTable(a.tolist(), d.tolist(), alpha.tolist(), theta.tolist())
    zero = np.asarray(ikdh.forward_kin(dh, np.zeros(6)))
    # Its last frame may be another than that of the table.
    tool = np.linalg.inv(zero) @ np.linalg.inv(base) @ np.asarray(robot.home)
    solver = ikdh.Solver(dh)
    _same_arm(robot, lambda q: base @ np.asarray(ikdh.forward_kin(dh, np.rad2deg(q))) @ tool)
    into, back = np.linalg.inv(base), np.linalg.inv(tool)
    return Peer(
        "ikdh",
        solver.solve,
        lambda answer: np.deg2rad(_rows(answer, 6)),
        given=lambda pose: into @ pose @ back,
    )


def _roboticstoolbox(robot: nj.Robot) -> Peer:
    """The analytic solver that the Robotics Toolbox derives from Denavit-Hartenberg parameters."""
    import roboticstoolbox as rtb

    if robot.joints != 6:
        raise UnsuitedError("arms of six joints")
    base, (a, alpha, d, theta), tool = denavit_hartenberg(robot)
    links = [
        rtb.RevoluteDH(a=a[i], alpha=alpha[i], d=d[i], offset=theta[i], qlim=[-np.pi, np.pi])
        for i in range(6)
    ]
    theirs = rtb.DHRobot(links, name=robot.name)
    _same_arm(robot, lambda q: base @ theirs.fkine(q).A @ tool)
    solver = theirs.analytic_ik()
    into, back = np.linalg.inv(base), np.linalg.inv(tool)
    return Peer(
        "roboticstoolbox",
        lambda pose: solver.solve(pose, joint_limits=False),
        lambda answer: _rows(answer.q, 6),
        given=lambda pose: into @ pose @ back,
    )


PEERS: dict[str, tuple[str, Callable[[nj.Robot], Peer]]] = {
    "ssik": ("ssik", _ssik),
    "eaik": ("eaik", _eaik),
    "ikdh": ("ikdh", _ikdh),
    "roboticstoolbox": ("roboticstoolbox-python", _roboticstoolbox),
}


def denavit_hartenberg(robot: nj.Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Standard parameters of an arm whose joints all turn (Spong, section 3.2).

    Returns:
        The pose of frame 0 in the base frame (4, 4); rows a, alpha, d and theta at home (4, n), in
        metres and radians; the tool in the last frame (4, 4).
    """
    screws, home = np.asarray(robot.screws), np.asarray(robot.home)
    z, point = screws[:, :3], np.cross(screws[:, :3], screws[:, 3:])
    frames = list[np.ndarray]()
    origin, x = point[0], np.cross(z[0], np.eye(3)[np.argmin(np.abs(z[0]))])
    x /= np.linalg.norm(x)
    for i in range(1, robot.joints):
        between, apart = np.cross(z[i - 1], z[i]), point[i] - point[i - 1]
        if (sine := np.linalg.norm(between)) < PARALLEL:
            # Common normals everywhere: the one through the origin before.
            foot = point[i] + z[i] * ((origin - point[i]) @ z[i])
            normal = foot - origin
            before = origin
        else:
            normal = between / sine
            along = np.linalg.solve(np.stack([z[i - 1], -z[i], normal], axis=1), apart)
            before, foot = point[i - 1] + z[i - 1] * along[0], point[i] + z[i] * along[1]
        if sine >= PARALLEL or np.linalg.norm(normal) > PARALLEL:
            x = normal - z[i] * (normal @ z[i])
            x /= np.linalg.norm(x)
        if i == 1:
            frames.append(_frame(x, z[0], before))
        frames.append(_frame(x, z[i], foot))
        origin = foot
    frames.append(frames[-1])
    step = np.array([np.linalg.inv(a) @ b for a, b in itertools.pairwise(frames)])
    theta = np.arctan2(step[:, 1, 0], step[:, 0, 0])
    alpha = np.arctan2(step[:, 2, 1], step[:, 2, 2])
    a = step[:, 0, 0] * step[:, 0, 3] + step[:, 1, 0] * step[:, 1, 3]
    tool = np.linalg.inv(frames[-1]) @ home
    return frames[0], np.stack([a, alpha, step[:, 2, 3], theta]), tool


def _frame(x: np.ndarray, z: np.ndarray, origin: np.ndarray) -> np.ndarray:
    frame = np.eye(4)
    frame[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    frame[:3, 3] = origin
    return frame
