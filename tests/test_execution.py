"""A timed joint trajectory on the simulated robot, through the installed pyniryo."""

from __future__ import annotations

import dataclasses
import importlib.util
import threading
import time

import numpy as np
import pytest

import niryo_jax as nj
from niryo_jax.hardware import (
    ArgumentRejected,
    CommandRefused,
    ExecutionAborted,
    ExecutionState,
    Fault,
    FaultKind,
    MotionNotReached,
    MotionStopped,
    NiryoArm,
    SimulatedNiryo,
    TargetRejected,
)
from niryo_jax.hardware.execution import MOST_STOPS
from niryo_jax.motion import JointTrajectory, joint_trajectory

pytestmark = [
    pytest.mark.skipif(
        importlib.util.find_spec("pyniryo") is None, reason="pyniryo is not installed"
    ),
    pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning"),
]

ROBOT = nj.robots.niryo_one()
START = np.array([0.2, -0.3, 0.1, 0.0, 0.5, -0.8])
END = np.array([-0.4, 0.1, -0.3, 0.3, -0.2, 0.4])
TRAJECTORY_COMMAND = "EXECUTE_TRAJECTORY_FROM_POSES_AND_JOINTS"


def straight(duration=2.0, samples=50):
    return joint_trajectory(START, END, duration, samples)


def bent(turn=0.5):
    """Two straight legs with a corner."""
    corner = START + turn * np.array([1, -1, 1, 0, 0, 0.5]) / 2
    first, second = (joint_trajectory(*ends, 1.5, 30) for ends in ((START, corner), (corner, END)))
    time = np.concatenate([first.time, 1.5 + np.asarray(second.time)[1:]])
    q = np.concatenate([first.q, np.asarray(second.q)[1:]])
    return JointTrajectory(time, q, np.zeros_like(q), np.zeros_like(q)), corner


@pytest.fixture(params=["4.1.1", "5.6.3"])
def any_sim(request):
    with SimulatedNiryo(time_scale=1000.0, version=request.param) as simulated:
        yield simulated


@pytest.fixture
def sim():
    with SimulatedNiryo(time_scale=1000.0) as simulated:
        yield simulated


def connected(sim, at=START, **options):
    arm = NiryoArm(sim.address, robot=ROBOT, timeout=60.0, **{"settle": 0.0, **options})
    arm.connect()
    arm.calibrate()
    arm.move_joints(at)
    return arm


def names(sim):
    return [request.command for request in sim.received]


def test_a_trajectory_ends_where_it_ends_on_every_system(any_sim):
    trajectory, _ = bent()
    with connected(any_sim) as arm:
        arm.use_tool()
        done = arm.execute(trajectory, keep_time=False)
        np.testing.assert_allclose(arm.joints(), END, atol=1e-3)
    np.testing.assert_allclose(done.reached[-1], END, atol=1e-3)
    assert done.reached_stop[-1] == len(done.stops) - 1
    assert done.deviation < 2e-3
    assert np.all(np.diff(done.arrival) > 0)
    # System 5 reports, and takes, poses of the tool centre point.
    assert (done.by == "trajectory") == (any_sim.version == "4.1.1")
    assert (TRAJECTORY_COMMAND in names(any_sim)) == (done.by == "trajectory")


@pytest.mark.parametrize("straight_tool", [False, True])
def test_between_the_stops_the_arm_keeps_to_the_trajectory(straight_tool):
    trajectory, corner = bent()
    arm = NiryoArm("127.0.0.1:1", robot=ROBOT)
    by = "trajectory" if straight_tool else "moves"
    planned = arm.execute(trajectory, by=by, within=0.005, dry_run=True)
    assert planned.reached.shape == (0, 6)
    assert planned.deviation == 0
    assert len(planned.stops) < len(trajectory.q)
    # The corner cannot be left out.
    assert np.min(np.max(np.abs(planned.stops - corner), axis=1)) < 0.01
    for q, pose in zip(trajectory.q, nj.forward_kinematics(ROBOT, trajectory.q), strict=True):
        assert distance_to_polyline(np.asarray(q), planned.stops) < 0.006
        if straight_tool:
            tool = np.asarray(nj.forward_kinematics(ROBOT, planned.stops))[:, :3, 3]
            assert distance_to_polyline(np.asarray(pose[:3, 3]), tool) < 2e-3


def distance_to_polyline(point, path):
    """Largest coordinate of the difference to the nearest point, densely sampled."""
    shares = np.linspace(0, 1, 400)[:, None, None]
    points = (1 - shares) * path[:-1] + shares * path[1:]
    return np.min(np.max(np.abs(points - point), axis=-1))


def test_a_straight_joint_line_is_one_move_at_the_speed_that_it_asks_for(sim):
    with connected(sim) as arm:
        arm.set_speed(77)
        done = arm.execute(straight(), by="moves", keep_time=False)
    assert len(done.stops) == 2
    # joint 1 turns by 0.6, joint 6 by 1.2 rad, at most 2 rad/s: in 2 s at 30 %.
    assert done.percent.tolist() == [30]
    speeds = [r.params[0] for r in sim.received if r.command == "SET_ARM_MAX_VELOCITY"]
    assert speeds == [77, 30, 77]


def test_the_arm_is_not_early():
    trajectory, _ = bent()
    with SimulatedNiryo(time_scale=1000.0) as sim, connected(sim) as arm:
        begin = time.monotonic()
        done = arm.execute(trajectory, by="moves")
    # Each leg begins at its time, so that the last one begins at the last stop but one.
    assert time.monotonic() - begin >= done.time[-2]
    assert np.all(done.arrival[1:] >= done.time[:-1])


@pytest.mark.parametrize("by", ["trajectory", "moves"])
def test_progress_is_told_piece_by_piece(sim, by):
    told = []
    trajectory, _ = bent()
    with connected(sim, piece=0.5) as arm:
        done = arm.execute(
            trajectory, by=by, keep_time=False, progress=lambda *numbers: told.append(numbers)
        )
    last = len(done.stops) - 1
    assert told[-1] == (last, last)
    assert [stop for stop, _ in told] == done.reached_stop[1:].tolist()
    assert len(told) >= 2


def test_stop_ends_it_at_a_stop_and_the_arm_can_go_on():
    trajectory, _ = bent()
    with SimulatedNiryo(time_scale=1.0) as sim:
        with connected(sim, settle=1.0) as arm:
            with pytest.raises(ExecutionAborted, match="stopped by the program") as caught:
                arm.execute(
                    trajectory,
                    by="moves",
                    progress=lambda *_: threading.Thread(target=arm.stop).start(),
                )
            assert caught.value.state == ExecutionState.STOPPED
            assert isinstance(caught.value.__cause__, MotionStopped)
            assert caught.value.stops_done > 0
            np.testing.assert_allclose(arm.joints(), caught.value.reached, atol=1e-3)
        assert sum(name == "MOVE_JOINTS" for name in names(sim)) == 1 + caught.value.stops_done


def test_an_arm_that_stands_elsewhere_ends_it_there(sim):
    trajectory, _ = bent()
    with connected(sim) as arm:
        sim.inject(Fault(FaultKind.STILL, command="MOVE_JOINTS"))
        with pytest.raises(ExecutionAborted) as caught:
            arm.execute(trajectory, by="moves", keep_time=False)
    assert caught.value.state == ExecutionState.DEVIATED
    assert isinstance(caught.value.__cause__, MotionNotReached)
    assert caught.value.stops_done == 0


def test_a_refusal_ends_it(sim):
    trajectory, _ = bent()
    with connected(sim) as arm:
        sim.arm.calibrated = False
        with pytest.raises(ExecutionAborted, match="calibrate") as caught:
            arm.execute(trajectory, keep_time=False)
        assert caught.value.state == ExecutionState.REFUSED
        assert isinstance(caught.value.__cause__, CommandRefused)
        np.testing.assert_allclose(arm.joints(), START, atol=1e-3)


def edited(**changes):
    base = straight()
    return dataclasses.make_dataclass("Edited", ["time", "q"])(
        **{"time": np.array(base.time), "q": np.array(base.q), **changes}
    )


def with_joint(sample, joint, value):
    q = np.array(straight().q)
    q[sample, joint] = value
    return edited(q=q)


@pytest.mark.parametrize(
    ("trajectory", "error", "words"),
    [
        (with_joint(7, 1, 0.7), TargetRejected, "sample 7 at 0.28.* joint_2"),
        (with_joint(7, 3, np.nan), TargetRejected, "sample 7 .* joint_4 is nan"),
        (with_joint(7, 3, 0.9), TargetRejected, "joint_4 turns at .* rad/s"),
        (straight(0.2), TargetRejected, "times the duration, or retime it"),
        (edited(time=np.zeros(50)), ArgumentRejected, "times that increase"),
        (edited(time=np.arange(49.0)), ArgumentRejected, r"got shapes \(49,\) and \(50, 6\)"),
        (edited(q=np.zeros((50, 5))), ArgumentRejected, r"\(k, 6\)"),
        (START, ArgumentRejected, "JointTrajectory"),
    ],
)
def test_nothing_is_sent_of_a_trajectory_that_cannot_be(trajectory, error, words):
    arm = NiryoArm("127.0.0.1:1", robot=ROBOT)
    with pytest.raises(error, match=words):
        arm.execute(trajectory)


def test_the_arm_must_stand_at_the_start(sim):
    with connected(sim, at=END) as arm:
        with pytest.raises(
            TargetRejected, match=r"joint_6 begins at -0.8000 rad and stands at 0.4000"
        ):
            arm.execute(straight())
        with pytest.raises(ArgumentRejected, match="by: expected"):
            arm.execute(straight(), by="magic")
    assert TRAJECTORY_COMMAND not in names(sim)


def test_a_long_trajectory_is_sent_in_frames_that_hold_it(sim):
    # A fine saw: every sample is a stop.
    time = np.linspace(0, 45.0, 451)
    q = np.tile(START, (len(time), 1))
    q[1::2, 0] += 0.05
    with connected(sim) as arm:
        done = arm.execute(edited(time=time, q=q), by="trajectory", within=1e-3, keep_time=False)
    assert len(done.stops) == 451 > MOST_STOPS
    assert len(done.reached) > 2
    assert done.deviation < 2e-3
