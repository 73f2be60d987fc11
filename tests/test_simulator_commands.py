"""The commands of the robot's server: through pyniryo itself, and the words of refusals."""

from __future__ import annotations

import ast
import importlib.util
import itertools
import socket

import numpy as np
import pytest

import niryo_jax as nj
from niryo_jax.hardware import SimulatedNiryo, protocol
from niryo_jax.lie.rpy import pose_from_rpy, rpy_from_pose
from niryo_jax.robots import MODELS

needs_pyniryo = pytest.mark.skipif(
    importlib.util.find_spec("pyniryo") is None, reason="pyniryo is not installed"
)
PREFIX = "An error occured while executing the last command : "
VERSIONS = ("4.1.1", "5.6.3")
ABOVE = (0.2, 0.0, 0.3, 0.0, 0.5, 0.0)


class Raw:
    """A client that knows nothing."""

    def __init__(self, sim: SimulatedNiryo) -> None:
        self.socket = socket.create_connection((sim.host, sim.port), 60.0)

    def __enter__(self) -> Raw:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def ask(self, command: str, *params: object) -> dict:
        self.socket.sendall(protocol.encode_frame(protocol.request(command, *params)))
        return ast.literal_eval(protocol.read_frame(self.read).decode())

    def read(self, size: int) -> bytes:
        return self.socket.recv(size, socket.MSG_WAITALL)

    def value(self, command: str, *params: object) -> list:
        answer = self.ask(command, *params)
        assert answer["status"] == "OK", answer
        return answer["list_ret_param"]


@pytest.fixture(params=VERSIONS)
def sim(request):
    with SimulatedNiryo(time_scale=1e4, version=request.param) as simulated:
        simulated.arm.calibrated = True
        yield simulated


@pytest.fixture
def old():
    with SimulatedNiryo(time_scale=1e4) as simulated:
        simulated.arm.calibrated = True
        yield simulated


@pytest.fixture
def raw(sim):
    with Raw(sim) as client:
        yield client


@pytest.fixture
def robot(sim, capfd):
    """pyniryo's own client; where the system is newer than it, what it gets is what it gets."""
    pyniryo = pytest.importorskip("pyniryo")
    client = pyniryo.NiryoRobot()
    client._NiryoRobot__client_socket = socket.create_connection((sim.host, sim.port))
    client._NiryoRobot__is_connected = True
    yield client
    client.close_connection()


def stands_at(sim: SimulatedNiryo, values, tool: str | None = None) -> None:
    """The tool frame, or the tool centre point of a tool, stands at x, y, z, roll, pitch, yaw."""
    pose = sim.arm.pose
    if tool is not None:
        offset = np.eye(4)
        offset[:3, 3] = sim.arm.model.tools[tool]
        pose = pose @ offset
    np.testing.assert_allclose(pose, pose_from_rpy(values), atol=1e-6)


# --- through pyniryo


@needs_pyniryo
class TestPyniryo:
    def test_poses_in_all_their_forms(self, sim, robot):
        from pyniryo import PoseObject, RobotAxis

        robot.move_pose(*ABOVE)
        stands_at(sim, ABOVE)
        robot.move_pose(PoseObject(0.2, 0.05, 0.3, 0.0, 0.5, 0.0))
        robot.shift_pose(RobotAxis.Y, -0.1)
        stands_at(sim, (0.2, -0.05, 0.3, 0.0, 0.5, 0.0))
        robot.shift_linear_pose(RobotAxis.Z, -0.04)
        stands_at(sim, (0.2, -0.05, 0.26, 0.0, 0.5, 0.0))
        robot.move_linear_pose(*ABOVE)
        stands_at(sim, ABOVE)
        x, y, z, *quaternion = robot.get_pose_quat()
        np.testing.assert_allclose((x, y, z), ABOVE[:3], atol=1e-6)
        np.testing.assert_allclose(quaternion, (0, np.sin(0.25), 0, np.cos(0.25)), atol=1e-6)

    def test_trajectories_end_at_their_last_point(self, sim, robot):
        poses = [[0.3, 0.1, 0.3, 0.0, 0.0, 0.0], [0.3, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0]]
        robot.execute_trajectory_from_poses([list(pose) for pose in poses], dist_smoothing=0.02)
        stands_at(sim, (0.3, 0.0, 0.3, 0.0, 0.0, 0.0))
        if sim.version == "4.1.1":
            robot.execute_trajectory_from_poses_and_joints(
                [list(ABOVE), [0.1, -0.2, -0.3, 0.0, 0.2, 0.0]], ["pose", "joint"]
            )
            expected = sim.arm.pose_at([0.1, -0.2, -0.3, 0.0, 0.2, 0.0])
            np.testing.assert_allclose(sim.arm.pose, expected, atol=1e-6)

    def test_pick_and_place_moves_the_object(self, sim, robot):
        robot.update_tool()
        robot.enable_tcp(False)
        pick = [0.148, -0.148, 0.088, 0.0, np.pi / 2, 0.0]
        place = [0.148, 0.148, 0.088, 0.0, np.pi / 2, 0.0]
        sim.place_object((0.148, -0.148, 0.0))
        robot.pick_from_pose(pick)
        assert sim.arm.holding
        stands_at(sim, [*pick[:2], pick[2] + 0.05, *pick[3:]])
        robot.place_from_pose(place)
        np.testing.assert_allclose(sim.object_position, (0.148, 0.148, 0.0), atol=1e-5)
        robot.pick_and_place(place, pick)
        np.testing.assert_allclose(sim.object_position, (0.148, -0.148, 0.0), atol=1e-5)

    def test_the_tool_centre_point(self, sim, robot):
        robot.update_tool()
        robot.enable_tcp(True)
        robot.move_pose(*ABOVE)
        stands_at(sim, ABOVE, tool="gripper_1")
        np.testing.assert_allclose(robot.get_pose().to_list(), ABOVE, atol=1e-6)
        robot.set_tcp(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        assert robot.get_pose().to_list() == pytest.approx(rpy_from_pose(sim.arm.pose))
        robot.reset_tcp()
        np.testing.assert_allclose(robot.get_pose().to_list(), ABOVE, atol=1e-6)
        robot.enable_tcp(False)
        assert robot.get_pose().to_list() == pytest.approx(rpy_from_pose(sim.arm.pose))

    def test_jog(self, sim, robot):
        robot.set_jog_control(True)
        before = sim.arm.joints
        robot.jog_joints(0.1, 0, 0, 0, 0, -0.1)
        np.testing.assert_allclose(robot.get_joints(), np.add(before, (0.1, 0, 0, 0, 0, -0.1)))
        position = sim.arm.pose[:3, 3]
        robot.jog_pose(0.0, 0.01, 0.0, 0.0, 0.0, 0.0)
        np.testing.assert_allclose(sim.arm.pose[:3, 3], np.add(position, (0, 0.01, 0)), atol=1e-6)
        robot.set_jog_control(False)
        robot.move_joints(0, 0, 0, 0, 0, 0)
        np.testing.assert_allclose(robot.get_joints(), np.zeros(6), atol=1e-9)

    def test_pins(self, sim, robot):
        from pyniryo import NiryoRobotException, PinID, PinMode, PinState

        assert {pin.mode for pin in robot.get_digital_io_state()} == {PinMode.INPUT, PinMode.OUTPUT}
        assert robot.digital_read(PinID.GPIO_1A) == PinState.LOW
        with pytest.raises(NiryoRobotException):
            robot.digital_write(PinID.GPIO_1A, PinState.HIGH)
        robot.set_pin_mode(PinID.GPIO_1A, PinMode.OUTPUT)
        robot.digital_write(PinID.GPIO_1A, PinState.HIGH)
        assert robot.digital_read(PinID.GPIO_1A) == PinState.HIGH
        with pytest.raises(NiryoRobotException, match="Unknown pin"):
            robot.digital_read(PinID.DI1)

    def test_what_is_not_plugged_in_is_refused(self, sim, robot):
        from pyniryo import ConveyorID, NiryoRobotException, ObjectColor, ObjectShape

        assert robot.set_conveyor() is ConveyorID.NONE
        with pytest.raises(NiryoRobotException, match="No conveyor found"):
            robot.run_conveyor(ConveyorID.ID_1)
        with pytest.raises(NiryoRobotException, match="No camera"):
            robot.vision_pick("workspace", 0.0, ObjectShape.ANY, ObjectColor.ANY)
        with pytest.raises(NiryoRobotException, match="No camera"):
            robot.get_camera_intrinsics()
        robot.get_joints()


@needs_pyniryo
def test_saved_poses_and_kinematics_through_pyniryo(old, capfd):
    import pyniryo

    client = pyniryo.NiryoRobot()
    client._NiryoRobot__client_socket = socket.create_connection((old.host, old.port))
    client._NiryoRobot__is_connected = True
    client.save_pose("above", *ABOVE)
    assert client.get_saved_pose_list() == ["above"]
    assert client.get_pose_saved("above").to_list() == list(ABOVE)
    client.delete_pose("above")
    for act in (client.get_pose_saved, client.delete_pose):
        with pytest.raises(pyniryo.NiryoRobotException, match="does not exist"):
            act("above")
    q = client.inverse_kinematics(*ABOVE)
    np.testing.assert_allclose(client.forward_kinematics(*q).to_list(), ABOVE, atol=6e-4)
    client.close_connection()


# --- where the arm gets


def test_every_pose_that_has_joints_inside_the_limits_is_reached(old):
    robot = old.arm.robot
    rng = np.random.default_rng(7)
    q = rng.uniform(robot.lower + 0.05, robot.upper - 0.05, (400, 6))
    poses = np.asarray(nj.forward_kinematics(robot, q))
    low, high = np.array(old.arm.model.position_bounds).T
    inside = np.all((low < poses[:, :3, 3]) & (poses[:, :3, 3] < high), axis=1)
    with Raw(old) as client:
        for pose in poses[inside][:40]:
            client.value("MOVE_POSE", *rpy_from_pose(pose), "")
            np.testing.assert_allclose(old.arm.pose, pose, atol=1e-6)


def test_a_linear_move_stays_on_its_line_and_is_refused_where_that_breaks(old):
    with Raw(old) as client:
        client.value("MOVE_POSE", 0.2, -0.15, 0.2, 0.0, 1.2, -0.3, "")
        client.value("MOVE_LINEAR_POSE", 0.2, 0.15, 0.3, 0.2, 1.0, 0.3, "")
        path = np.array([old.arm.pose_at(q)[:3, 3] for q in old.arm._path])
        way = path[-1] - path[0]
        off = path - path[0] - np.outer((path - path[0]) @ way / (way @ way), way)
        assert np.max(np.abs(off)) < 1e-6
        client.value("MOVE_POSE", 0.2, -0.2, 0.2, 0.0, 1.5, -0.8, "")
        through_the_base = client.ask("MOVE_LINEAR_POSE", -0.2, 0.2, 0.2, 0.0, 1.5, 2.4, "")
        assert through_the_base["message"].endswith("MoveIt failed to compute the plan.")


# --- what is refused, and how


def test_lower_case_is_the_same_command(raw):
    answer = raw.ask("get_joints")
    assert (answer["status"], answer["command"]) == ("OK", "GET_JOINTS")


@pytest.mark.parametrize(
    ("command", "good"),
    [("MOVE_JOINTS", 6), ("MOVE_POSE", 7), ("GET_JOINTS", 0), ("PICK_FROM_POSE", 6)],
)
def test_wrong_counts_are_refused_by_both_numbers(raw, sim, command, good):
    modern = sim.version == "5.6.3"
    for given in {0, good - 1, good + 1, 40} - {good, -1}:
        message = raw.ask(command, *[0.0] * given)["message"]
        expected = f"[{good}]" if modern else str(good)
        assert message.startswith(f"{expected} parameters expected but {given} given\nIn function")
        assert message.endswith("server and the client") is modern
    if modern:
        raw.value("HANDSHAKE", "1.2.5")
        assert "handshake" not in raw.ask("GET_JOINTS", 0)["message"]


def test_the_handshake_tells_old_clients_that_they_are(sim, raw):
    if sim.version == "4.1.1":
        assert raw.ask("HANDSHAKE", "1.2.5")["message"] == "Unknown command"
        return
    assert raw.value("HANDSHAKE", "1.2.5") == [{}]
    assert "outdated version of PyNiryo" in raw.value("HANDSHAKE", "1.1.2")[0]["message"]


WORDS = [
    (("MOVE_JOINTS", "a", 0, 0, 0, 0, 0), "Expected the following type: float"),
    (
        ("CALIBRATE", "SOMEHOW"),
        "Expected one of the following: ['MANUAL', 'AUTO'].\nGiven: SOMEHOW",
    ),
    (("SET_LEARNING_MODE", "maybe"), "Expected one of the following: ['TRUE', 'FALSE']"),
    (("SET_ARM_MAX_VELOCITY", 101), "Expected the following type: float/integer [1 -100]"),
    (("SET_ARM_MAX_VELOCITY", 200), "Expected the following type: float/integer [1 -100]"),
    (("SET_ARM_MAX_VELOCITY", 0), "Expected the following type: float/integer [1 -100]"),
    (("OPEN_GRIPPER", 500.0, 100, 30), "Expected the following type: int"),
    (("SHIFT_POSE", "W", 0.1), "Expected one of the following: ['X', 'Y', 'Z', 'ROLL', 'PITCH'"),
    (("EXECUTE_TRAJECTORY_FROM_POSES", [[0.1, 0.2]], 0.0), "7 or 6 parameters expected, given: 2"),
    (("EXECUTE_TRAJECTORY_FROM_POSES", [], 0), "Expected the following type: float"),
    (("MOVE_JOINTS", None, 0, 0, 0, 0, 0), "float() argument must be"),
]


@pytest.mark.parametrize(("asked", "words"), WORDS)
def test_the_servers_own_checks_have_no_prefix(raw, asked, words):
    command, *params = asked
    body = repr({"command": command, "param_list": params}).encode()
    raw.socket.sendall(len(body).to_bytes(2, "little") + body)
    answer = ast.literal_eval(protocol.read_frame(raw.read).decode())
    assert (answer["status"], answer["command"]) == ("KO", command)
    assert answer["message"].startswith(words)


BEHIND = {
    ("MOVE_POSE", 0.2, 0, 0.3, 0, 0, 0, "table"): "Frame table does not exist",
    (
        "MOVE_POSE",
        0,
        0.6,
        0.3,
        0,
        0,
        0,
        "",
    ): "Goal has been aborted : y not in range ( -0.5 , 0.5 )",
    (
        "MOVE_POSE",
        0,
        0,
        0.7,
        0,
        0,
        0,
        "",
    ): "Goal has been aborted : z not in range ( -0.15 , 0.65 )",
    ("MOVE_JOINTS", 0, 9, 0, 0, 0, 0): "Goal has been aborted : joint_2 not in range (-1.91",
    ("SHIFT_POSE", "X", 1.5): "Goal has been aborted : shift value can't be null and < -1 or > 1",
    ("OPEN_GRIPPER", 500, 100, 30): "Goal has been aborted : Command 'open_gripper' is not availab",
    ("PULL_AIR_VACUUM_PUMP",): "Goal has been aborted : Tools ID do not match",
    ("INVERSE_KINEMATICS", 0.6, 0, 0.6, 0, 0, 0): "Failed to perform invert kinematic",
    ("MOVE_JOINTS", 10**400, 0, 0, 0, 0, 0): "int too large to convert to float",
}


@pytest.mark.parametrize("request_", BEHIND, ids=lambda r: str(r)[:40])
def test_what_lies_behind_the_server_refuses_with_its_prefix(old, request_):
    with Raw(old) as client:
        answer = client.ask(*request_)
    assert (answer["status"], answer["command"]) == ("KO", request_[0])
    assert answer["message"].startswith(PREFIX + BEHIND[request_])


CHECKS = [
    ("connected", False, "Goal has been rejected : Motor connection problem"),
    ("calibrated", False, "Goal has been rejected : You need to calibrate"),
    ("jog_mode", True, "Goal has been rejected : You need to deactivate jog controller"),
]


@pytest.mark.parametrize("first", range(len(CHECKS)))
def test_the_checks_before_a_move_come_in_the_robots_order(old, first):
    for name, value, _ in CHECKS[first:]:
        setattr(old.arm, name, value)
    for command, *params in (
        ("MOVE_JOINTS", 9, 0, 0, 0, 0, 0),
        ("MOVE_POSE", 9, 0, 0, 0, 0, 0, ""),
        ("SHIFT_POSE", "X", 9),
    ):
        with Raw(old) as client:
            assert client.ask(command, *params)["message"].startswith(PREFIX + CHECKS[first][2])
        assert old.arm.learning_mode, "which is left after these checks, and before the limits"


def test_system_5_answers_ok_to_whatever_lies_behind_its_server_and_does_nothing():
    with SimulatedNiryo(time_scale=1e4, version="5.6.3") as sim, Raw(sim) as client:
        joints = {f"joint_{i}": 0.1 for i in range(6)} | {"obj_type": "JOINTS"}
        five = {key: value for key, value in joints.items() if key != "joint_5"}
        refused = [
            ("MOVE_JOINTS", *[0.1] * 6),
            ("OPEN_GRIPPER", 500, 100, 30),
            ("MOVE", five, "FALSE"),
        ]
        for request in refused:
            assert client.value(*request) == []
        sim.arm.calibrated = True
        sim.arm.collision_detected = True
        assert client.value("MOVE_JOINTS", *[0.1] * 6) == []
        assert client.value("GET_COLLISION_DETECTED") == ["True"]
        assert not np.any(sim.arm.joints)
        client.value("CLEAR_COLLISION_DETECTED")
        linear = client.ask("MOVE", joints, "TRUE")
        assert linear["message"].startswith("The robot can only do a linear move with a pose")
        client.value("MOVE", joints, "FALSE")
        np.testing.assert_allclose(sim.arm.joints, 0.1)


def test_pick_place_and_jog_of_system_5_take_joints_and_poses():
    with SimulatedNiryo(time_scale=1e4, version="5.6.3") as sim, Raw(sim) as client:
        sim.arm.calibrated = True
        client.value("UPDATE_TOOL")
        client.value("ENABLE_TCP", "FALSE")
        keys = ("x", "y", "z", "roll", "pitch", "yaw")
        pick = dict(zip(keys, (0.148, -0.148, 0.088, 0.0, np.pi / 2, 0.0), strict=True))
        place = np.deg2rad((45, -46.8656, -34.8624, 0, -8.2720, 45))
        sim.place_object((0.148, -0.148, 0.0))
        client.value("PICK", {**pick, "obj_type": "POSE"})
        assert sim.arm.holding
        joints = {f"joint_{i}": float(angle) for i, angle in enumerate(place)}
        client.value("PLACE", {**joints, "obj_type": "JOINTS"})
        np.testing.assert_allclose(sim.object_position, (0.148, 0.148, 0.0), atol=1e-5)
        before = sim.arm.joints
        client.value("JOG", {f"joint_{i}": 0.01 for i in range(6)} | {"obj_type": "JOINTS"})
        np.testing.assert_allclose(client.value("GET_JOINTS"), before + 0.01, atol=1e-9)


def test_booleans_come_as_the_robot_writes_them(raw):
    assert raw.value("SET_LEARNING_MODE", "TRUE") == [[1, ""]]
    assert raw.value("GET_LEARNING_MODE") == ["True"]
    assert raw.value("SET_JOG_CONTROL", "FALSE") == [[1, "Jog Controller - Already Disabled"]]
    raw.value("SET_JOG_CONTROL", "TRUE")
    assert raw.value("SET_JOG_CONTROL", "FALSE") == [[1, "Jog Controller - Disabled"]]


@pytest.mark.parametrize(("name", "version"), list(itertools.product(MODELS, VERSIONS)))
def test_the_hardware_status_names_the_model(name, version):
    with SimulatedNiryo(MODELS[name], version=version) as sim, Raw(sim) as client:
        status = client.value("GET_HARDWARE_STATUS")
    assert status[1] == name.removeprefix("niryo_")
    assert status[2:6] == ["True", "''", "True", "False"]
    assert len({len(column) for column in status[6:]}) == 1


def test_the_pose_of_system_5_is_that_of_the_tool_centre_point(sim, raw):
    raw.value("UPDATE_TOOL")
    modern = sim.version == "5.6.3"
    distance = np.linalg.norm(raw.value("GET_POSE")[:3] - sim.arm.pose[:3, 3])
    offset = np.linalg.norm(sim.arm.model.tools["gripper_1"])
    assert distance == pytest.approx(offset if modern else 0.0, abs=1e-6)
