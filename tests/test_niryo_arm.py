"""`NiryoArm` through the installed pyniryo against the simulated robot and against impostors."""

from __future__ import annotations

import contextlib
import importlib
import importlib.metadata
import importlib.util
import math
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import warnings

import jax.numpy as jnp
import numpy as np
import pytest

from niryo_jax import robots
from niryo_jax.hardware import (
    ArgumentRejected,
    CallTimeout,
    CommandRefused,
    ConnectionFailed,
    ConnectionLost,
    Fault,
    FaultKind,
    MotionNotReached,
    NiryoArm,
    NiryoError,
    NotANiryo,
    PyniryoMissing,
    RobotBusy,
    SimulatedNiryo,
    TargetRejected,
    ToolMissing,
    pyniryo_version,
)

pytestmark = pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning")
needs_pyniryo = pytest.mark.skipif(
    importlib.util.find_spec("pyniryo") is None, reason="pyniryo is not installed"
)

ROBOT = robots.niryo_one()
TARGET = np.array([0.2, -0.3, 0.1, 0.0, 0.5, -0.8])
FAST = 1000.0


@pytest.fixture(autouse=True)
def notes(tmp_path, monkeypatch):
    """A folder for the notes about unanswered requests."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def arm_at(address: str, *, timeout: float = 5.0, **options) -> NiryoArm:
    return NiryoArm(address, robot=ROBOT, timeout=timeout, **{"settle": 0.0, **options})


@pytest.fixture(params=["4.1.1", "5.6.3"])
def any_sim(request):
    with SimulatedNiryo(time_scale=FAST, version=request.param) as simulated:
        yield simulated


@pytest.fixture
def sim():
    with SimulatedNiryo(time_scale=FAST) as simulated:
        yield simulated


@pytest.fixture
def arm(sim):
    with arm_at(sim.address) as connected:
        connected.calibrate()
        connected.set_speed(100)
        yield connected


@contextlib.contextmanager
def impostor(reply: bytes | None, *, close: bool):
    """Address of a server that sends `reply` to the first bytes of each (None: at once none)."""
    listener = socket.create_server(("127.0.0.1", 0))
    listener.settimeout(0.05)
    done = threading.Event()

    def serve() -> None:
        with contextlib.ExitStack() as open_ones:
            while not done.is_set():
                with contextlib.suppress(OSError):
                    connection = open_ones.enter_context(listener.accept()[0])
                    if reply is not None:
                        connection.recv(1024)
                        connection.sendall(reply)
                    if close:
                        connection.close()

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield "{}:{}".format(*listener.getsockname())
    finally:
        done.set()
        thread.join()
        listener.close()


def assert_free(sim: SimulatedNiryo) -> None:
    """The robot serves one client: that a new one is served proves the connection closed."""
    sim.clear_faults()
    with arm_at(sim.address, connect_timeout=2.0) as other:
        other.joints()


# --- without pyniryo


def test_importing_hardware_imports_neither_pyniryo_nor_opencv():
    code = (
        "import sys, niryo_jax.hardware; sys.exit(not {'pyniryo', 'cv2'}.isdisjoint(sys.modules))"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_pyniryo_missing_says_how_to_install_it(monkeypatch):
    def absent(_: str) -> str:
        raise importlib.metadata.PackageNotFoundError

    monkeypatch.setattr(importlib.metadata, "version", absent)
    with pytest.raises(PyniryoMissing, match=r'pip install "niryo_jax\[robot\]"'):
        arm_at("127.0.0.1").connect()


@pytest.mark.parametrize("version", ["1.0.5", "1.3.0", "2.0.0", "0.1"])
def test_unknown_pyniryo_is_refused(monkeypatch, version):
    monkeypatch.setattr(importlib.metadata, "version", lambda _: version)
    with pytest.raises(PyniryoMissing, match=f"pyniryo {version} is installed and not supported"):
        pyniryo_version()


def test_pyniryo_that_does_not_import_says_how_to_install_it(monkeypatch):
    def broken(_: str) -> None:
        raise ImportError("no module named enum34")

    monkeypatch.setattr(importlib.metadata, "version", lambda _: "1.1.2")
    monkeypatch.setattr(importlib, "import_module", broken)
    with pytest.raises(PyniryoMissing, match=r"enum34.*pip install"):
        arm_at("127.0.0.1").connect()
    assert type(sys.modules.get("cv2")).__name__ != "_NoOpenCV"


@needs_pyniryo
def test_the_arm_moves_where_opencv_lacks_its_system_libraries(tmp_path):
    (tmp_path / "cv2.py").write_text("raise ImportError('libGL.so.1: cannot open shared object')")
    code = f"""
import sys
sys.path.insert(0, {str(tmp_path)!r})
import niryo_jax as nj
from niryo_jax.hardware import NiryoArm, SimulatedNiryo
with SimulatedNiryo(time_scale=100) as sim:
    with NiryoArm(sim.address, robot=nj.robots.niryo_one()) as arm:
        arm.calibrate()
        arm.move_joints([0.1] * 6)
assert "cv2" not in sys.modules
"""
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize(
    ("version", "warned"), [("1.1.2", False), ("1.1.0", False), ("1.2.5", True)]
)
def test_pyniryo_for_other_robots_warns(monkeypatch, version, warned):
    monkeypatch.setattr(importlib.metadata, "version", lambda _: version)
    assert ("niryo_one" in pyniryo_version().fits) is not warned
    monkeypatch.setattr("niryo_jax.hardware.link.PyniryoClient", lambda *_: None)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        arm_at("127.0.0.1").connect()
    assert [str(w.message)[:24] for w in caught] == ["pyniryo 1.2.5 is made fo"] * warned


@pytest.mark.parametrize(
    ("host", "options", "words"),
    [
        ("", {}, "host"),
        ("robot:", {}, "host: expected a name, or name:port"),
        ("robot:http", {}, "host"),
        ("robot", {"port": 0}, "port 1 to 65535"),
        ("robot:70000", {}, "port 1 to 65535"),
        ("robot:5000", {"port": 5001}, "port: 5001 contradicts host 'robot:5000'"),
        ("robot", {"timeout": 0.0}, "timeout: expected a positive number, got 0.0"),
        ("robot", {"connect_timeout": math.inf}, "connect_timeout"),
        ("robot", {"tolerance": math.nan}, "tolerance"),
        ("robot", {"settle": math.nan}, "settle: expected zero or more seconds"),
    ],
)
def test_arguments_are_checked(host, options, words):
    with pytest.raises(ArgumentRejected, match=words):
        arm_at(host, **options)


def test_robot_must_have_six_joints():
    planar = ROBOT.from_screws(ROBOT.screws[:3], ROBOT.home, name="planar")
    with pytest.raises(ArgumentRejected, match="6 joints, got planar with 3"):
        NiryoArm("127.0.0.1", robot=planar)


def test_calls_before_connecting_are_refused():
    with pytest.raises(ConnectionLost, match=r"not connected to 127\.0\.0\.1:40001"):
        arm_at("127.0.0.1").joints()


def test_every_error_has_the_one_base_and_none_is_an_oserror():
    for error in NiryoError.__subclasses__():
        assert not issubclass(error, OSError), "pyniryo would swallow it"


# --- work


@needs_pyniryo
def test_a_session(any_sim, capfd):
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        with NiryoArm(any_sim.address, port=any_sim.port, robot=ROBOT) as arm:
            assert arm.needs_calibration is True
            arm.calibrate()
            assert arm.needs_calibration is False
            arm.set_speed(30)
            assert arm.learning_mode is True
            np.testing.assert_array_equal(arm.move_joints(TARGET), TARGET)
            assert arm.learning_mode is False
            arm.learning_mode = True
            assert arm.learning_mode is True
            np.testing.assert_array_equal(arm.joints(), TARGET)
            np.testing.assert_allclose(arm.pose(), any_sim.arm.pose, atol=1e-6)
            arm.wait(0.0)
    assert capfd.readouterr() == ("", ""), "pyniryo's own prints and logs are kept away"
    assert_free(any_sim)


@needs_pyniryo
def test_pick_and_place(sim, arm):
    sim.place_object((0.148, -0.148, 0.0))
    assert arm.use_tool("gripper_1") == "gripper_1"
    arm.move_joints(np.deg2rad([-45, -46.8656, -34.8624, 0, -8.2720, -45]))
    arm.grasp()
    arm.move_joints(np.deg2rad([45, -46.8656, -34.8624, 0, -8.2720, 45]))
    arm.release()
    np.testing.assert_allclose(sim.object_position, (0.148, 0.148, 0.0), atol=1e-5)


@needs_pyniryo
def test_float32_and_jax_targets_are_sent_as_plain_numbers(sim, arm):
    for target in (TARGET.astype(np.float32), jnp.asarray(TARGET, jnp.float32), list(TARGET)):
        np.testing.assert_allclose(arm.move_joints(target), TARGET, atol=1e-6)
    moves = [r.params for r in sim.received if r.command == "MOVE_JOINTS"]
    assert all(type(angle) is float for params in moves for angle in params)


@needs_pyniryo
def test_only_move_joints_is_sent_for_moves(any_sim):
    with arm_at(any_sim.address) as arm:
        arm.calibrate()
        arm.move_joints(TARGET)
    commands = [request.command for request in any_sim.received]
    assert commands.count("MOVE_JOINTS") == 1
    assert "MOVE" not in commands


@needs_pyniryo
def test_tool_is_checked(sim, arm):
    for act in (arm.grasp, arm.release):
        with pytest.raises(ToolMissing, match="has detected no tool"):
            act()
    with pytest.raises(ToolMissing, match=r"expected the tool 'gripper_2', .* 'gripper_1'"):
        arm.use_tool("gripper_2")
    assert arm.tool == "gripper_1"
    assert not {"GRASP_WITH_TOOL", "RELEASE_WITH_TOOL"} & {r.command for r in sim.received}


# --- refusals on our side: nothing is sent


BAD_TARGETS = {
    "joint_2 = 0.7 rad .* limits, -1.910088 to 0.6400122 rad": [0, 0.7, 0, 0, 0, 0],
    "joint_2 = 0.6405122 rad": [0, ROBOT.upper[1] + 5e-4, 0, 0, 0, 0],
    "joint_3 is nan": [0, 0, math.nan, 0, 0, 0],
    "joint_6 is -inf": [0, 0, 0, 0, 0, -math.inf],
    r"shape \(6,\), got shape \(5,\)": [0] * 5,
    r"got shape \(1, 6\)": [[0] * 6],
    "expected 6 joint angles in radians, got 'home'": "home",
    "joint_1 is nan": [None] * 6,
}


@needs_pyniryo
@pytest.mark.parametrize("words", BAD_TARGETS)
def test_bad_targets_send_nothing(sim, arm, words):
    before = sim.received
    with pytest.raises(TargetRejected, match=words):
        arm.move_joints(BAD_TARGETS[words])
    assert sim.received == before
    arm.joints()


@needs_pyniryo
@pytest.mark.parametrize("version", ["4.1.1", "5.6.3"])
@pytest.mark.parametrize("limit", ["lower", "upper"])
def test_targets_at_the_very_limit_are_drawn_in(version, limit):
    edge = getattr(ROBOT, limit)
    with SimulatedNiryo(time_scale=FAST, version=version) as sim, arm_at(sim.address) as arm:
        arm.calibrate()
        reached = arm.move_joints(edge)
    np.testing.assert_allclose(np.abs(reached - edge), 1e-3, rtol=1e-9)


@needs_pyniryo
@pytest.mark.parametrize("percent", [0, 101, 30.5, math.nan, -1])
def test_bad_speeds_send_nothing(sim, arm, percent):
    before = sim.received
    with pytest.raises(ArgumentRejected, match="whole number 1 to 100"):
        arm.set_speed(percent)
    assert sim.received == before


@needs_pyniryo
@pytest.mark.parametrize("seconds", [-1.0, math.nan, math.inf])
def test_bad_waits_are_refused(arm, seconds):
    with pytest.raises(ArgumentRejected, match="seconds: expected zero or more"):
        arm.wait(seconds)


# --- the robot refuses, or says that it moved


@needs_pyniryo
def test_refusals_carry_the_robots_words_and_leave_the_connection_open(sim):
    with arm_at(sim.address) as arm:
        with pytest.raises(CommandRefused, match="refused move_joints: Goal has been rej") as info:
            arm.move_joints(TARGET)
        assert info.value.reason == (
            "Goal has been rejected : You need to calibrate the robot before sending a command"
        )
        arm.calibrate()
        arm.move_joints(TARGET)


@needs_pyniryo
def test_ok_without_moving_is_noticed(sim, arm):
    sim.inject(Fault(FaultKind.STILL, "MOVE_JOINTS", occurrence=1))
    with pytest.raises(MotionNotReached, match=r"joint_6 stands at 0.0000 rad .* -0.8000") as info:
        arm.move_joints(TARGET)
    np.testing.assert_array_equal(info.value.target, TARGET)
    np.testing.assert_array_equal(info.value.reached, np.zeros(6))
    assert info.value.difference == pytest.approx(0.8)
    arm.move_joints(TARGET)


@needs_pyniryo
def test_silent_refusal_of_system_5_is_noticed():
    with SimulatedNiryo(version="5.6.3") as sim, arm_at(sim.address) as arm:
        with pytest.raises(MotionNotReached):
            arm.move_joints(TARGET)
        assert arm.needs_calibration is True


@needs_pyniryo
def test_joints_are_given_time_to_settle(sim):
    sim.inject(Fault(FaultKind.STILL, "MOVE_JOINTS"))
    with arm_at(sim.address, settle=5.0) as arm:
        arm.calibrate()
        arrive = threading.Timer(0.1, sim.arm.move, [TARGET])
        arrive.start()
        np.testing.assert_allclose(arm.move_joints(TARGET), TARGET, atol=0.02)
        arrive.join()


# --- faults of the line


FAULTS = [
    (FaultKind.SILENT, CallTimeout, "did not answer get_joints within 0.3 s"),
    (FaultKind.DROP, ConnectionLost, "closed the connection during get_joints"),
    (FaultKind.CUT, ConnectionLost, "closed the connection during get_joints"),
    (FaultKind.GARBAGE, NotANiryo, "answered get_joints with something"),
    (FaultKind.DELAY, CallTimeout, "did not answer get_joints"),
    (FaultKind.STILL, NotANiryo, "the six joint angles"),
    (FaultKind.REFUSE, CommandRefused, "Injected fault"),
]


@needs_pyniryo
@pytest.mark.parametrize(("kind", "error", "words"), FAULTS, ids=[f[0].name for f in FAULTS])
def test_every_fault_ends_in_its_error_in_time(sim, kind, error, words):
    threads = set(threading.enumerate())
    with contextlib.ExitStack() as stack:
        arm = stack.enter_context(arm_at(sim.address, timeout=0.3))
        sim.inject(Fault(kind, "GET_JOINTS", seconds=1.0))
        begin = time.monotonic()
        with pytest.raises(error, match=words):
            arm.joints()
        assert time.monotonic() - begin < 2.0
        assert set(threading.enumerate()) == threads
        if error is not CommandRefused:
            before = sim.received
            with pytest.raises(ConnectionLost, match=r"get_pose was not sent: .* is closed"):
                arm.pose()
            assert sim.received == before
            assert_free(sim)
    assert_free(sim)


@needs_pyniryo
@pytest.mark.parametrize(
    ("kind", "error"), [(FaultKind.DROP, ConnectionLost), (FaultKind.CUT, ConnectionLost)]
)
def test_losing_the_robot_in_a_move_says_that_the_move_goes_on(kind, error):
    with SimulatedNiryo(time_scale=5.0) as sim:
        with arm_at(sim.address) as arm:
            arm.calibrate()
            sim.inject(Fault(kind, "MOVE_JOINTS"))
            with pytest.raises(error, match="during move_joints; a move that was under way goes"):
                arm.move_joints(TARGET)
        while not np.array_equal(sim.arm.joints, TARGET):
            time.sleep(0.01)
        assert_free(sim)


@needs_pyniryo
def test_a_move_may_take_longer_than_other_answers():
    with SimulatedNiryo(time_scale=1.0) as sim, arm_at(sim.address, timeout=0.2) as arm:
        arm.calibrate()
        arm.set_speed(100)
        begin = time.monotonic()
        arm.move_joints([0, 0, 0.8, 0, 0, 0])
        assert time.monotonic() - begin >= 0.399


@needs_pyniryo
def test_a_move_that_is_never_answered_ends_in_time(sim):
    sim.inject(Fault(FaultKind.SILENT, "MOVE_JOINTS"))
    with arm_at(sim.address, timeout=0.2) as arm:
        arm.calibrate()
        arm.set_speed(100)
        with pytest.raises(CallTimeout, match="did not answer move_joints"):
            arm.move_joints([0, 0, 0.1, 0, 0, 0])
    assert_free(sim)


@needs_pyniryo
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no interval timers on this system")
def test_ctrl_c_interrupts_a_call_and_closes_the_connection(sim):
    sim.inject(Fault(FaultKind.SILENT, "GET_POSE"))
    previous = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        arm = arm_at(sim.address, timeout=60.0)
        arm.connect()
        signal.setitimer(signal.ITIMER_REAL, 0.2)
        with pytest.raises(KeyboardInterrupt):
            arm.pose()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)
    with pytest.raises(ConnectionLost):
        arm.joints()
    assert_free(sim)


@needs_pyniryo
def test_close_from_another_thread_ends_a_blocked_call(sim):
    sim.inject(Fault(FaultKind.SILENT, "GET_POSE"))
    with arm_at(sim.address, timeout=60.0) as arm:
        closer = threading.Timer(0.1, arm.close)
        closer.start()
        with pytest.raises(ConnectionLost):
            arm.pose()
        closer.join()


@needs_pyniryo
def test_an_error_of_the_user_closes_the_connection(sim):
    with pytest.raises(ZeroDivisionError), arm_at(sim.address):
        raise ZeroDivisionError
    assert_free(sim)


# --- no robot


@needs_pyniryo
def test_second_client_is_told_that_the_robot_is_busy(sim):
    with arm_at(sim.address), pytest.raises(RobotBusy, match="close the other program"):
        arm_at(sim.address, connect_timeout=0.2).connect()
    assert_free(sim)


@needs_pyniryo
def test_nobody_listens():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(ConnectionFailed, match=f"127.0.0.1:{port} refused the connection"):
        arm_at(f"127.0.0.1:{port}").connect()


@needs_pyniryo
def test_host_never_accepts():
    with socket.create_server(("127.0.0.1", 0), backlog=1) as listener:
        host, port = listener.getsockname()
        fillers = [socket.socket() for _ in range(8)]
        for filler in fillers:
            filler.setblocking(False)
            filler.connect_ex((host, port))
        begin = time.monotonic()
        with pytest.raises(ConnectionFailed, match=r"within 0\.3 s"):
            arm_at(f"{host}:{port}", connect_timeout=0.3).connect()
        assert time.monotonic() - begin < 2.0
        for filler in fillers:
            filler.close()


@needs_pyniryo
@pytest.mark.parametrize("host", ["no-such-host.invalid", "bad..name"])
def test_host_is_unknown(host):
    with pytest.raises(ConnectionFailed, match="cannot be reached"):
        arm_at(host).connect()


def framed(text: bytes) -> bytes:
    return len(text).to_bytes(2, "little") + text


@needs_pyniryo
@pytest.mark.parametrize(
    ("reply", "close", "error"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", True, NotANiryo),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", False, NotANiryo),
        (b"O", True, NotANiryo),
        (framed(b"KO,no such command"), False, NotANiryo),
        (framed(b"{}"), False, NotANiryo),
        (framed(b"[1, 2]"), False, NotANiryo),
        (framed(b'{"state": "OK"}'), False, NotANiryo),
        (framed(b'{"status": "FINE"}'), False, NotANiryo),
        (framed(b"\xff\xfe"), False, NotANiryo),
        (None, True, NotANiryo),
        (None, False, RobotBusy),
    ],
)
def test_what_answers_is_no_robot(reply, close, error):
    threads = set(threading.enumerate())
    with (
        impostor(reply, close=close) as address,
        pytest.raises(error, match=address),
    ):
        arm_at(address, connect_timeout=0.3).connect()
    assert set(threading.enumerate()) == threads
