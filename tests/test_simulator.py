"""The simulated robot over raw sockets: frames, answers, motion in time, gripping, faults."""

from __future__ import annotations

import ast
import socket
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from niryo_jax import robots
from niryo_jax.hardware import Fault, FaultKind, SimulatedNiryo, protocol
from niryo_jax.lie.rpy import pose_from_rpy, rpy_from_pose

FAST = 1000.0
TARGET = (0.2, -0.3, 0.1, 0.0, 0.5, -0.8)
PREFIX = "An error occured while executing the last command : "
UNCALIBRATED = (
    PREFIX + "Goal has been rejected : You need to calibrate the robot before sending a command"
)


class Client:
    """The least that speaks the protocol."""

    def __init__(self, sim: SimulatedNiryo, timeout: float = 60.0) -> None:
        self.socket = socket.create_connection((sim.host, sim.port), timeout)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def send(self, command: str, *params: object) -> None:
        self.socket.sendall(protocol.encode_frame({"command": command, "param_list": list(params)}))

    def read(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            part = self.socket.recv(size - len(data))
            if not part:
                raise EOFError(data)
            data += part
        return data

    def answer(self) -> dict:
        return ast.literal_eval(protocol.read_frame(self.read).decode())

    def ask(self, command: str, *params: object) -> dict:
        self.send(command, *params)
        return self.answer()

    def value(self, command: str, *params: object) -> list:
        answer = self.ask(command, *params)
        assert answer["status"] == "OK", answer
        assert answer["command"] == command
        assert answer["payload_size"] == 0
        return answer["list_ret_param"]


@pytest.fixture
def sim():
    with SimulatedNiryo(time_scale=FAST) as simulated:
        yield simulated


@pytest.fixture
def client(sim):
    with Client(sim) as connected:
        yield connected


def ready(client: Client) -> Client:
    client.value("CALIBRATE", "AUTO")
    client.value("UPDATE_TOOL")
    return client


def go(client: Client, *degrees: float) -> None:
    client.value("MOVE_JOINTS", *np.deg2rad(degrees).tolist())


def test_frame_is_little_endian_length_and_json():
    assert protocol.encode_frame({"a": 1}) == b'\x08\x00{"a": 1}'
    with pytest.raises(protocol.ProtocolError, match="65535"):
        protocol.encode_frame({"a": "x" * 70000})


def test_unknown_command(client):
    assert client.ask("NO_SUCH") == {
        "command": "",
        "status": "KO",
        "message": "Unknown command",
        "list_ret_param": [],
    }
    assert client.ask("HANDSHAKE", "1.2.5")["message"] == "Unknown command"
    assert client.ask("MOVE", {}, "FALSE")["message"] == "Unknown command"


@pytest.mark.parametrize(
    "body",
    [
        b'{"command": "MOVE_JOINTS", "param_list": [NaN, 0, 0, 0, 0, 0]}',
        b'{"command": "SET_LEARNING_MODE", "param_list": [true]}',
        b'{"command": "GET_JOINTS", "param_list": null}',
        b'{"command": "GET_JOINTS", "param_list": [], "extra": 1}',
        b'{"command": "GET_JOINTS"}',
        b"GET / HTTP/1.1",
        b"\xff\xfe",
    ],
)
def test_what_is_no_request_ends_the_connection_and_not_the_server(sim, body):
    with Client(sim) as client:
        client.socket.sendall(len(body).to_bytes(2, "little") + body)
        with pytest.raises(EOFError):
            client.answer()
    with Client(sim) as client:
        assert client.value("GET_JOINTS") == [0.0] * 6
    assert [request.command for request in sim.received] == ["GET_JOINTS"]


def test_session_seen_on_the_real_server(client):
    refused = client.ask("MOVE_JOINTS", *TARGET)
    assert (refused["status"], refused["message"]) == ("KO", UNCALIBRATED)
    assert "payload_size" not in refused
    client.value("CALIBRATE", "AUTO")
    assert client.value("MOVE_JOINTS", *TARGET) == []
    assert client.value("GET_JOINTS") == list(TARGET)
    pose = client.value("GET_POSE")
    np.testing.assert_allclose(pose, [0.3032, 0.0615, 0.3708, -0.8, -0.3, 0.2], atol=5e-5)
    assert client.value("FORWARD_KINEMATICS", *TARGET) == [[round(value, 3) for value in pose]]
    refused = client.ask("MOVE_JOINTS", 0.2, 0.70, 0.1, 0.0, 0.5, -0.8)
    words, _, limits = refused["message"].partition("(")
    assert words == PREFIX + "Goal has been aborted : joint_2 not in range "
    lower_upper = [float(limit) for limit in limits.rstrip(")").split(",")]
    np.testing.assert_allclose(lower_upper, [-1.9100883333827199, 0.6400122367063628], rtol=1e-12)
    beyond = client.ask("MOVE_POSE", 2.0, 0.0, 0.3, 0.0, 0.0, 0.0, "")
    assert beyond["message"] == PREFIX + "Goal has been aborted : x not in range ( -0.5 , 0.5 )"
    unreachable = client.ask("MOVE_POSE", 0.49, 0.49, 0.6, 0.0, 0.0, 0.0, "")
    assert unreachable["message"].endswith("MoveIt failed to compute the plan.")
    assert client.value("GET_JOINTS") == list(TARGET)


@pytest.mark.parametrize("version", ["4.1.1", "5.6.3"])
def test_pose_targets(version):
    pose = [0.25, 0.05, 0.35, 0.1, 0.2, 0.3]
    with SimulatedNiryo(time_scale=FAST, version=version) as sim, Client(sim) as client:
        client.value("CALIBRATE", "AUTO")
        client.value("MOVE_JOINTS", *TARGET)
        if version == "4.1.1":
            (q,) = client.value("INVERSE_KINEMATICS", *pose)
        else:
            keys = ("x", "y", "z", "roll", "pitch", "yaw")
            position = dict(zip(keys, pose, strict=True))
            (answer,) = client.value("INVERSE_KINEMATICS", position)
            q = [answer[f"joint_{i}"] for i in range(6)]
            client.value("MOVE", {**position, "obj_type": "POSE"}, "FALSE")
        np.testing.assert_allclose(rpy_from_pose(sim.arm.pose_at(q)), pose, atol=1e-5)
        client.value("MOVE_POSE", *pose, "")
        np.testing.assert_allclose(client.value("GET_POSE"), pose, atol=1e-5)


def test_limits_are_compared_exactly(client):
    ready(client)
    upper = float(robots.niryo_one().upper[1])
    client.value("MOVE_JOINTS", 0.0, upper, 0.0, 0.0, 0.0, 0.0)
    beyond = client.ask("MOVE_JOINTS", 0.0, float(np.nextafter(upper, 1)), 0.0, 0.0, 0.0, 0.0)
    assert beyond["status"] == "KO"


def test_a_move_switches_learning_mode_off_even_one_that_is_refused_for_its_limits(client):
    assert client.value("GET_LEARNING_MODE") == ["True"]
    client.ask("MOVE_JOINTS", *TARGET)
    assert client.value("GET_LEARNING_MODE") == ["True"], "the calibration is checked first"
    client.value("CALIBRATE", "AUTO")
    assert client.ask("MOVE_JOINTS", 9, 0, 0, 0, 0, 0)["status"] == "KO"
    assert client.value("GET_LEARNING_MODE") == ["False"]
    client.value("SET_LEARNING_MODE", "TRUE")
    client.value("MOVE_JOINTS", *TARGET)
    assert client.value("GET_LEARNING_MODE") == ["False"]


@pytest.mark.parametrize(
    ("command", "params"),
    [
        ("MOVE_JOINTS", [1, 2, 3]),
        ("MOVE_JOINTS", ["a", 0, 0, 0, 0, 0]),
        ("SET_LEARNING_MODE", ["maybe"]),
        ("SET_ARM_MAX_VELOCITY", [101]),
        ("SET_ARM_MAX_VELOCITY", []),
        ("GET_JOINTS", [1]),
        ("INVERSE_KINEMATICS", [0.2, 0, 0.3]),
        ("INVERSE_KINEMATICS", [2.0, 0, 0.3, 0, 0, 0]),
        ("MOVE_POSE", [0.2, 0, 0.3, 0, 0, 0]),
        ("MOVE_POSE", [0.2, 0, 0.3, 0, 0, 0, "somewhere"]),
    ],
)
def test_bad_parameters_are_refused_and_the_connection_stays(client, command, params):
    ready(client)
    assert client.ask(command, *params)["status"] == "KO"
    assert client.value("GET_JOINTS") == [0.0] * 6


def test_calibration_shows_in_the_hardware_status(client):
    assert client.value("GET_HARDWARE_STATUS")[4] == "True"
    client.value("CALIBRATE", "AUTO")
    assert client.value("GET_HARDWARE_STATUS")[4] == "False"


@pytest.mark.parametrize(("percent", "seconds"), [(100, 0.25), (50, 0.5)])
def test_a_move_takes_its_time_and_is_answered_at_its_end(percent, seconds):
    with SimulatedNiryo(time_scale=2.0) as sim, Client(sim) as client:
        ready(client)
        client.value("SET_ARM_MAX_VELOCITY", percent)
        begin = time.monotonic()
        client.send("MOVE_JOINTS", 0.5, 0.0, -1.0, 0.0, 0.0, 0.0)
        while not np.any(sim.arm.joints):
            time.sleep(0.001)
        on_the_way = sim.arm.joints
        client.answer()
        assert time.monotonic() - begin >= seconds - 1e-3
        np.testing.assert_array_equal(sim.arm.joints, [0.5, 0.0, -1.0, 0.0, 0.0, 0.0])
        assert 0 < on_the_way[0] < 0.5, "the answer waited"
        assert on_the_way[2] == pytest.approx(-2 * on_the_way[0]), "joints arrive together"


def test_losing_the_client_does_not_stop_the_arm():
    with SimulatedNiryo(time_scale=10.0) as sim:
        with Client(sim) as client:
            ready(client)
            client.send("MOVE_JOINTS", *TARGET)
            while not np.any(sim.arm.joints):
                time.sleep(0.001)
        with Client(sim) as client:
            client.send("GET_JOINTS")
            late = client.answer()
            assert (late["command"], late["status"]) == ("MOVE_JOINTS", "OK"), "of the first client"
            np.testing.assert_allclose(client.answer()["list_ret_param"], TARGET)


def test_second_client_is_accepted_and_served_only_after_the_first_has_left(sim):
    with Client(sim) as first:
        assert first.value("GET_LEARNING_MODE") == ["True"]
        with Client(sim, timeout=0.2) as waiting:
            waiting.send("GET_JOINTS")
            with pytest.raises(TimeoutError):
                waiting.answer()
            first.socket.close()
            waiting.socket.settimeout(60.0)
            assert waiting.answer()["list_ret_param"] == [0.0] * 6


PICK_ABOVE = (-45, -29.0303, -38.3463, 0, -22.6234, -45)
PICK = (-45, -46.8656, -34.8624, 0, -8.2720, -45)
PLACE_ABOVE = (45, -29.0303, -38.3463, 0, -22.6234, 45)
PLACE = (45, -46.8656, -34.8624, 0, -8.2720, 45)


def test_pick_and_place_of_table_2_1(sim, client):
    ready(client)
    sim.place_object((0.148, -0.148, 0.0))
    go(client, *PICK_ABOVE)
    go(client, *PICK)
    client.value("CLOSE_GRIPPER", 500, 100, 20)
    assert sim.arm.holding
    go(client, *PICK_ABOVE)
    assert sim.object_position is not None
    np.testing.assert_allclose(sim.object_position, (0.148, -0.148, 0.062), atol=1e-5)
    go(client, *PLACE_ABOVE)
    go(client, *PLACE)
    client.value("OPEN_GRIPPER", 500, 100, 30)
    go(client, *PLACE_ABOVE)
    assert not sim.arm.holding
    np.testing.assert_allclose(sim.object_position, (0.148, 0.148, 0.0), atol=1e-5)


def test_gripping_too_high_or_without_a_tool_grips_nothing(sim, client):
    client.value("CALIBRATE", "AUTO")
    sim.place_object((0.148, -0.148, 0.0))
    go(client, *PICK)
    client.value("GRASP_WITH_TOOL")
    assert not sim.arm.holding, "no tool was detected yet"
    client.value("UPDATE_TOOL")
    assert client.value("GET_CURRENT_TOOL_ID") == ["GRIPPER_1"]
    go(client, *PICK_ABOVE)
    client.value("GRASP_WITH_TOOL")
    assert sim.arm.grasping
    assert not sim.arm.holding, "62 mm too high"
    go(client, *PICK)
    assert not sim.arm.holding, "the gripper is closed already"
    client.value("RELEASE_WITH_TOOL")
    client.value("GRASP_WITH_TOOL")
    assert sim.arm.holding


def test_an_object_released_in_the_air_falls_to_the_table(sim, client):
    ready(client)
    assert sim.object_position is None
    sim.place_object((0.148, -0.148, 0.0))
    go(client, *PICK)
    client.value("GRASP_WITH_TOOL")
    go(client, *PLACE_ABOVE)
    client.value("RELEASE_WITH_TOOL")
    np.testing.assert_allclose(sim.object_position, (0.148, 0.148, 0.0), atol=1e-5)


def test_system_5_answers_ok_to_moves_it_refuses():
    with SimulatedNiryo(time_scale=FAST, version="5.6.3") as sim, Client(sim) as client:
        assert client.value("HANDSHAKE", "1.2.5") == [{}]
        assert client.value("MOVE_JOINTS", *TARGET) == []
        assert client.value("GET_JOINTS") == [0.0] * 6, "not calibrated"
        client.value("CALIBRATE", "AUTO")
        client.value("MOVE_JOINTS", 0, 0.7, 0, 0, 0, 0)
        client.value("MOVE_POSE", 2.0, 0, 0.3, 0, 0, 0, "")
        assert client.value("GET_JOINTS") == [0.0] * 6, "out of limits, unreachable"
        position = {f"joint_{i}": angle for i, angle in enumerate(TARGET)}
        position |= {"metadata": {"version": 1}, "obj_type": "JOINTS"}
        client.value("MOVE", position, "FALSE")
        assert client.value("GET_JOINTS") == list(TARGET)
        pose = client.value("FORWARD_KINEMATICS", position)[0]
        assert pose["x"] == pytest.approx(0.3032, abs=5e-5)
        assert client.ask("NO_SUCH")["payload_size"] == 0


def test_fault_shows_at_its_command_and_occurrence_only(sim, client):
    sim.inject(Fault(FaultKind.REFUSE, "GET_JOINTS", occurrence=2, message="tired"))
    assert client.ask("GET_JOINTS")["status"] == "OK"
    assert client.ask("GET_POSE")["status"] == "OK"
    assert client.ask("GET_JOINTS")["message"] == "tired"
    assert client.ask("GET_JOINTS")["status"] == "OK"
    sim.inject(Fault(FaultKind.REFUSE))
    assert [client.ask(name)["status"] for name in ("GET_JOINTS", "UPDATE_TOOL")] == ["KO", "KO"]
    sim.clear_faults()
    assert client.ask("GET_JOINTS")["status"] == "OK"


def test_fault_still_and_delay(sim, client):
    ready(client)
    sim.inject(Fault(FaultKind.STILL, "MOVE_JOINTS", occurrence=1))
    client.value("MOVE_JOINTS", *TARGET)
    assert client.value("GET_JOINTS") == [0.0] * 6
    sim.inject(Fault(FaultKind.DELAY, "GET_JOINTS", seconds=0.1))
    begin = time.monotonic()
    client.value("GET_JOINTS")
    assert time.monotonic() - begin >= 0.099


def test_fault_garbage_cut_silent(sim):
    sim.inject(Fault(FaultKind.GARBAGE, "GET_JOINTS", occurrence=1, data=b"HTTP/1.1 400"))
    sim.inject(Fault(FaultKind.SILENT, "UPDATE_TOOL"))
    sim.inject(Fault(FaultKind.CUT, "GET_POSE"))
    with Client(sim) as client:
        client.send("GET_JOINTS")
        assert client.read(12) == b"HTTP/1.1 400"
        client.send("UPDATE_TOOL")
        client.send("GET_CURRENT_TOOL_ID")
        assert client.answer()["list_ret_param"] == ["GRIPPER_1"], "carried out, not answered"
        client.send("GET_POSE")
        with pytest.raises(EOFError) as cut:
            client.answer()
        assert cut.value.args[0].startswith(b'{"status"')


def test_fault_drop_closes_in_the_middle_of_a_move_which_goes_on():
    drop = Fault(FaultKind.DROP, "MOVE_JOINTS")
    with SimulatedNiryo(time_scale=2.0, faults=[drop]) as sim:
        with Client(sim) as client:
            ready(client)
            client.send("MOVE_JOINTS", 0.0, 0.0, 0.8, 0.0, 0.0, 0.0)
            with pytest.raises(EOFError):
                client.answer()
            assert 0 < sim.arm.joints[2] < 0.8
        with Client(sim) as client:
            assert client.ask("GET_JOINTS")["command"] == "MOVE_JOINTS", "the late answer"
            assert client.answer()["list_ret_param"][2] == 0.8


@pytest.mark.parametrize("moving", [False, True])
def test_close_ends_the_thread_with_a_client_connected(moving):
    with SimulatedNiryo(time_scale=0.001) as sim, Client(sim) as client:
        ready(client)
        if moving:
            client.send("MOVE_JOINTS", *TARGET)
        sim.close()
        assert not [t for t in threading.enumerate() if t.name.endswith(str(sim.port))]
        with pytest.raises((EOFError, ConnectionError)):
            client.ask("GET_JOINTS")


def test_arguments_are_checked():
    with pytest.raises(ValueError, match="time_scale: expected a positive number, got 0"):
        SimulatedNiryo(time_scale=0)
    with pytest.raises(ValueError, match="version"):
        SimulatedNiryo(version="3.0.0")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="tool: expected one of none, gripper_1"):
        SimulatedNiryo(tool="hammer")


angle = st.one_of(st.floats(-3.1, 3.1), st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi]))


@given(st.tuples(angle, angle, angle))
def test_roll_pitch_yaw_rebuild_the_rotation_at_gimbal_lock_too(angles):
    pose = pose_from_rpy((0.1, 0.2, 0.3, *angles))
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(pose_from_rpy(rpy_from_pose(pose)), pose, atol=1e-14)


def test_roll_pitch_yaw_order():
    roll, pitch, yaw = 0.3, -0.4, 0.5
    about_z = pose_from_rpy((0, 0, 0, 0, 0, yaw))
    about_y = pose_from_rpy((0, 0, 0, 0, pitch, 0))
    about_x = pose_from_rpy((0, 0, 0, roll, 0, 0))
    expected = about_z @ about_y @ about_x
    np.testing.assert_allclose(pose_from_rpy((0, 0, 0, roll, pitch, yaw)), expected, atol=1e-15)
    np.testing.assert_allclose(about_x[1:3, 1], [np.cos(roll), np.sin(roll)])
    np.testing.assert_allclose(about_y[[2, 0], 2], [np.cos(pitch), np.sin(pitch)])
    np.testing.assert_allclose(about_z[:2, 0], [np.cos(yaw), np.sin(yaw)])
