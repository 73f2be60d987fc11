"""Whose answer it is, which arm answers, and why something did not happen."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import itertools
import re
import socket
import tempfile
import threading
import time

import numpy as np
import pytest
from niryo_server import RobotServer

from niryo_jax import robots
from niryo_jax.hardware import (
    ArgumentRejected,
    CallTimeout,
    CommandRefused,
    ConnectionFailed,
    Fault,
    FaultKind,
    MotionNotReached,
    MotionStopped,
    NiryoArm,
    NiryoError,
    RobotBusy,
    SimulatedNiryo,
    ToolFailed,
    WrongArm,
    protocol,
)
from niryo_jax.robots import MODELS

pytestmark = [
    pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning"),
    pytest.mark.skipif(
        importlib.util.find_spec("pyniryo") is None, reason="pyniryo is not installed"
    ),
]

ROBOT = robots.niryo_one()
TARGET = np.array([0.2, -0.3, 0.1, 0.0, 0.5, -0.8])
FAST = 1000.0
VERSIONS = ("4.1.1", "5.6.3")


@pytest.fixture(autouse=True)
def notes(tmp_path, monkeypatch):
    """The folder of the notes about unanswered requests."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def arm_at(address: str, **options) -> NiryoArm:
    return NiryoArm(address, robot=ROBOT, **{"timeout": 10.0, "settle": 0.0, **options})


def leave_in_a_move(address: str, q=TARGET) -> None:
    """A program that ends while its move is under way."""
    arm = arm_at(address)
    arm.connect()
    threading.Timer(0.1, arm.close).start()
    with contextlib.suppress(NiryoError):
        arm.move_joints(q)


# --- whose answer it is


@pytest.mark.parametrize("version", VERSIONS)
def test_a_program_started_again_in_a_move_waits_for_it_and_reads_its_own_answers(version):
    with SimulatedNiryo(time_scale=1.0, version=version) as sim:
        sim.arm.calibrated = True
        leave_in_a_move(sim.address)
        with arm_at(sim.address) as again:
            np.testing.assert_allclose(again.joints(), TARGET)
            assert again.learning_mode is False
            np.testing.assert_allclose(again.move_joints(np.zeros(6)), 0, atol=1e-6)


def test_a_move_of_an_earlier_program_that_lasts_longer_is_named():
    with RobotServer(move=2.0) as server:
        leave_in_a_move(server.address)
        with pytest.raises(RobotBusy, match="finishing a move of an earlier program"):
            arm_at(server.address, timeout=0.3).connect()


def test_attempts_during_a_move_leave_one_request_behind_at_most_and_never_wedge_the_server():
    with RobotServer(move=4.0) as server:
        leave_in_a_move(server.address)
        for _ in range(5):
            with pytest.raises(ConnectionFailed, match="earlier program"):
                arm_at(server.address, connect_timeout=0.1, timeout=0.1).connect()
        deadline = time.monotonic() + 20.0
        while not np.array_equal(server.joints, TARGET):
            assert time.monotonic() < deadline
            time.sleep(0.01)
        with arm_at(server.address) as arm:
            np.testing.assert_array_equal(arm.joints(), TARGET)
        assert not server.wedged


def test_the_stand_in_wedges_where_each_attempt_leaves_a_request_behind():
    with RobotServer(move=1.0, head_start=1.0) as server, contextlib.ExitStack() as stack:
        name, port = server.address.split(":")
        for command, params in [("MOVE_JOINTS", TARGET.tolist()), *[("GET_JOINTS", [])] * 3]:
            client = stack.enter_context(socket.create_connection((name, int(port)), 5.0))
            client.sendall(protocol.encode_frame(protocol.request(command, *params)))
            client.close()
        deadline = time.monotonic() + 20.0
        while not server.wedged and time.monotonic() < deadline:
            time.sleep(0.05)
        assert server.wedged


@contextlib.contextmanager
def server_that_says_first(*late: dict[str, object]):
    """A robot, each of whose answers to GET_POSE comes behind answers to other commands."""
    listener = socket.create_server(("127.0.0.1", 0))
    listener.settimeout(0.05)
    done = threading.Event()
    values = {"GET_JOINTS": [0.0] * 6, "GET_POSE": [0.2, 0.0, 0.3, 0.0, 0.0, 0.0]}

    def read(client: socket.socket) -> None:
        def whole(size: int) -> bytes:
            data = client.recv(size, socket.MSG_WAITALL)
            if len(data) < size:
                raise EOFError
            return data

        with contextlib.suppress(EOFError, OSError), client:
            while True:
                request = protocol.parse_request(protocol.read_frame(whole))
                answers = [protocol.ok(request.command, values.get(request.command, []))]
                if request.command == "GET_POSE":
                    answers = [*late, *answers]
                client.sendall(b"".join(map(protocol.encode_frame, answers)))

    def serve() -> None:
        while not done.is_set():
            with contextlib.suppress(OSError):
                read(listener.accept()[0])

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield "{}:{}".format(*listener.getsockname())
    finally:
        done.set()
        thread.join()
        listener.close()


def test_answers_that_name_another_command_are_dropped():
    late = [
        protocol.ok("MOVE_JOINTS"),
        protocol.ok("GET_JOINTS", [1.0] * 6),
        protocol.ko("MOVE_POSE", "no"),
    ]
    with server_that_says_first(*late) as address, arm_at(address) as arm:
        for _ in range(3):
            np.testing.assert_allclose(arm.pose()[:3, 3], (0.2, 0.0, 0.3))
            np.testing.assert_array_equal(arm.joints(), np.zeros(6))


# --- which arm answers


@pytest.mark.parametrize(("there", "ours"), list(itertools.product(MODELS, MODELS)))
def test_the_wrong_arm_is_refused_and_nothing_moves(there, ours):
    with SimulatedNiryo(MODELS[there], time_scale=FAST) as sim:
        arm = NiryoArm(sim.address, robot=MODELS[ours].robot())
        if there == ours:
            with arm:
                assert arm.status().model == ours
        else:
            with pytest.raises(WrongArm, match=f"is a {there}; expected a {ours}"):
                arm.connect()
        assert not np.any(sim.arm.joints)


def test_the_model_that_may_answer_can_be_named():
    with SimulatedNiryo(MODELS["niryo_ned2"]) as sim:
        for name in ("niryo_ned2", "ned2"):
            with arm_at(sim.address, model=name) as arm:
                arm.joints()
        fitted = dataclasses.replace(ROBOT, name="my arm, calibrated")
        with NiryoArm(sim.address, robot=fitted) as arm:
            arm.joints()
        with pytest.raises(WrongArm, match="expected a niryo_one"):
            NiryoArm(sim.address, robot=fitted, model="niryo_one").connect()


@pytest.mark.parametrize("kind", [FaultKind.STILL, FaultKind.REFUSE])
def test_a_robot_that_does_not_say_what_it_is_is_driven(kind):
    fault = Fault(kind, "GET_HARDWARE_STATUS")
    with SimulatedNiryo(faults=[fault]) as sim, arm_at(sim.address) as arm:
        arm.joints()


# --- why something did not happen


def spoil(sim: SimulatedNiryo, **changes: object) -> None:
    for name, value in changes.items():
        assert hasattr(sim.arm, name)
        setattr(sim.arm, name, value)


REASONS = {
    "not calibrated: call calibrate": {"calibrated": False},
    "its motors are not connected": {"connected": False},
    "detected a collision": {"collision_detected": True},
    "was in jog mode, which is switched off now": {"jog_mode": True},
    "outside the limits of its own system": {"upper": np.full(6, 0.1)},
}


@pytest.mark.parametrize("words", REASONS)
def test_a_silent_refusal_is_explained(words):
    with SimulatedNiryo(time_scale=FAST, version="5.6.3") as sim, arm_at(sim.address) as arm:
        arm.calibrate()
        arm.learning_mode = False
        spoil(sim, **REASONS[words])
        with pytest.raises(MotionNotReached, match=words):
            arm.move_joints(TARGET)


def test_after_jog_mode_was_named_the_move_can_be_sent_again():
    with SimulatedNiryo(time_scale=FAST, version="5.6.3") as sim, arm_at(sim.address) as arm:
        arm.calibrate()
        spoil(sim, jog_mode=True)
        with pytest.raises(MotionNotReached, match="jog mode"):
            arm.move_joints(TARGET)
        np.testing.assert_array_equal(arm.move_joints(TARGET), TARGET)


def test_a_move_that_was_held_up_is_told_from_one_that_was_refused():
    with SimulatedNiryo(time_scale=FAST) as sim, arm_at(sim.address) as arm:
        arm.calibrate()
        sim.inject(Fault(FaultKind.STILL, "MOVE_JOINTS"))
        threading.Timer(0.1, sim.arm.move, [TARGET / 2]).start()
        slow = arm_at(sim.address, settle=0.5)
        arm.close()
        with slow, pytest.raises(MotionNotReached, match="held up on its way"):
            slow.move_joints(TARGET)


def test_the_collision_flag_outlives_programs_until_it_is_cleared():
    with SimulatedNiryo(time_scale=FAST, version="5.6.3") as sim:
        with arm_at(sim.address) as arm:
            arm.calibrate()
            assert arm.collision_detected is False
            spoil(sim, collision_detected=True)
        with arm_at(sim.address) as arm:
            assert arm.collision_detected is True
            arm.clear_collision()
            assert arm.collision_detected is False
            arm.move_joints(TARGET)


def test_system_4_has_no_collision_flag():
    with SimulatedNiryo() as sim, arm_at(sim.address) as arm:
        assert arm.collision_detected is False
        with pytest.raises(CommandRefused, match="Unknown command"):
            arm.clear_collision()
        arm.joints()


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("act", ["grasp", "release"])
def test_a_tool_that_fails_is_noticed(version, act):
    with SimulatedNiryo(time_scale=FAST, version=version) as sim, arm_at(sim.address) as arm:
        arm.use_tool("gripper_1")
        getattr(arm, act)()
        spoil(sim, tool_overloaded=True)
        error = CommandRefused if version == "4.1.1" else ToolFailed
        with pytest.raises(error, match="Timeout" if version == "4.1.1" else r"tool \(error 32\)"):
            getattr(arm, act)()
        arm.joints()


@pytest.mark.parametrize("version", VERSIONS)
def test_the_words_of_the_robot_are_one_line_without_what_its_server_adds(version):
    fault = Fault(FaultKind.REFUSE, "GET_POSE", message="first\nsecond\r\n third")
    with SimulatedNiryo(version=version, faults=[fault]) as sim, arm_at(sim.address) as arm:
        with pytest.raises(CommandRefused) as info:
            arm.pose()
        assert info.value.reason == "first second third"
        assert str(info.value) == "the robot refused get_pose: first second third"


# --- times, limits, arguments


@pytest.mark.parametrize(("percent", "seconds"), [(None, 1.3), (100, 1.3), (10, 4.0), (1, 31.0)])
def test_the_time_of_a_move_is_worked_out_for_the_speed_of_the_robot(percent, seconds):
    with SimulatedNiryo(time_scale=FAST) as sim, arm_at(sim.address, timeout=1.0) as arm:
        arm.calibrate()
        if percent is not None:
            arm.set_speed(percent)
        sim.inject(Fault(FaultKind.SILENT, "MOVE_JOINTS"))
        closer = threading.Timer(2.0, arm.close)
        closer.start()
        with pytest.raises(NiryoError) as info:
            arm.move_joints([0.2, 0, 0, 0, 0, 0])
        closer.cancel()
        if seconds > 2:
            assert not isinstance(info.value, CallTimeout)
        else:
            (told,) = re.findall(r"within ([\d.]+) s", str(info.value))
            assert float(told) == pytest.approx(seconds, abs=0.05)


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("version", VERSIONS)
def test_limits_rounded_to_float32_are_accepted(name, version):
    model = MODELS[name]
    robot = model.robot()
    with (
        SimulatedNiryo(model, time_scale=FAST, version=version) as sim,
        NiryoArm(sim.address, robot=robot, settle=0.0) as arm,
    ):
        arm.calibrate()
        for joint, limits in itertools.product(range(6), (robot.lower, robot.upper)):
            q = np.zeros(6, np.float32)
            q[joint] = limits[joint]
            reached = arm.move_joints(q)
            assert abs(reached[joint] - limits[joint]) == pytest.approx(1e-3, rel=1e-6)


@pytest.mark.parametrize("percent", ["50", None, [50], "fast", np.nan])
def test_a_speed_that_is_no_number_is_named(percent):
    with (
        SimulatedNiryo() as sim,
        arm_at(sim.address) as arm,
        pytest.raises(ArgumentRejected, match="percent: expected a whole number 1 to 100"),
    ):
        arm.set_speed(percent)


@pytest.mark.parametrize(
    ("host", "options", "words"),
    [
        (None, {}, "host: expected a name, or name:port, got None"),
        (b"robot", {}, "host"),
        ("robot", {"robot": "niryo_one"}, "robot: expected a Robot, got 'niryo_one'"),
        ("robot", {"port": "40001"}, "port: expected a whole number, got '40001'"),
        ("robot", {"timeout": "20"}, "timeout: expected a positive number, got '20'"),
        ("robot", {"piece": 0}, "piece: expected a positive number, got 0"),
        ("robot", {"model": 2}, "model: expected the name of a model"),
    ],
)
def test_arguments_of_wrong_types_are_named(host, options, words):
    with pytest.raises(ArgumentRejected, match=words):
        NiryoArm(host, **{"robot": ROBOT, **options})


# --- stop, and joints during a move


@pytest.mark.parametrize("version", VERSIONS)
def test_a_move_in_pieces_can_be_watched_and_stopped(version):
    target = [2.0, 0, 0, 0, 0, 0]
    with (
        SimulatedNiryo(time_scale=1.0, version=version) as sim,
        arm_at(sim.address, piece=0.05) as arm,
    ):
        arm.calibrate()
        seen: list[float] = []

        def watch() -> None:
            while len(seen) < 3:
                seen.append(float(arm.joints()[0]))
            arm.stop()

        watcher = threading.Thread(target=watch)
        watcher.start()
        with pytest.raises(MotionStopped) as info:
            arm.move_joints(target)
        watcher.join()
        assert seen == sorted(seen)
        assert seen[-1] < 1.5
        np.testing.assert_array_equal(info.value.reached, arm.joints())
        np.testing.assert_array_equal(info.value.reached, sim.arm.joints)
        np.testing.assert_allclose(arm.move_joints(target), target, atol=1e-3)


def test_pieces_lie_on_the_straight_way_and_end_at_the_target():
    with SimulatedNiryo(time_scale=FAST) as sim, arm_at(sim.address, piece=0.05) as arm:
        arm.calibrate()
        np.testing.assert_array_equal(arm.move_joints(TARGET), TARGET)
        sent = np.array([r.params for r in sim.received if r.command == "MOVE_JOINTS"])
        assert len(sent) == 8, "0.8 rad at 2 rad/s are 0.4 s"
        np.testing.assert_allclose(sent, np.arange(1, 9)[:, None] / 8 * TARGET, atol=1e-12)


# --- what is remembered from one program to the next


def test_an_unanswered_request_is_noted_until_the_robot_answers_again(notes):
    with SimulatedNiryo(time_scale=FAST) as sim:
        with arm_at(sim.address, timeout=0.2) as arm:
            arm.joints()
            assert not list(notes.iterdir())
            sim.inject(Fault(FaultKind.SILENT, "GET_POSE"))
            with pytest.raises(CallTimeout):
                arm.pose()
        assert len(list(notes.iterdir())) == 1
        with arm_at(sim.address) as arm:
            arm.joints()
        assert not list(notes.iterdir())


def test_one_connection_is_made_where_nothing_was_left_unanswered(notes):
    accepted = []
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        client = listener.accept()[0]
        accepted.append(client)
        with contextlib.suppress(OSError), client:
            while head := client.recv(2, socket.MSG_WAITALL):
                body = client.recv(int.from_bytes(head, "little"), socket.MSG_WAITALL)
                request = protocol.parse_request(body)
                client.sendall(protocol.encode_frame(protocol.ok(request.command, [0.1] * 6)))

    thread = threading.Thread(target=serve)
    thread.start()
    with arm_at("{}:{}".format(*listener.getsockname())) as arm:
        np.testing.assert_array_equal(arm.joints(), [0.1] * 6)
    thread.join()
    listener.close()
    assert len(accepted) == 1


def test_notes_cannot_be_written_and_nothing_depends_on_them(notes, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(notes / "missing"))
    with SimulatedNiryo(time_scale=1.0) as sim:
        sim.arm.calibrated = True
        leave_in_a_move(sim.address)
        with arm_at(sim.address) as again:
            np.testing.assert_allclose(again.joints(), TARGET)
