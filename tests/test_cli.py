"""The command `niryo-jax`: its results, its exit codes, and what it says of mistakes."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("rich")

import niryo_jax as nj
from niryo_jax.hardware import Fault, FaultKind, SimulatedNiryo
from niryo_jax.hardware.pick_and_place import OBJECT_END, TABLE_2_1
from niryo_jax.robots import MODELS

needs_pyniryo = pytest.mark.skipif(
    importlib.util.find_spec("pyniryo") is None, reason="pyniryo is not installed"
)
PICK = ["0.148", "-0.148", "0.088", "--rpy", "0", "90", "0"]
UNREACHABLE = ["--matrix", "1 0 0 5; 0 1 0 0; 0 0 1 0"]


def start(*arguments: str, **options) -> subprocess.Popen:
    command = [sys.executable, "-m", "niryo_jax.cli", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, **options)


# --- importing


def test_importing_the_package_needs_jax_and_numpy_alone():
    code = """
import sys
blocked = ("pyniryo", "typer", "rich", "scipy.optimize", "click", "viser")
sys.modules.update(dict.fromkeys(blocked))
import niryo_jax as nj
pose = nj.forward_kinematics(nj.robots.niryo_one(), [0.0] * 6)
assert abs(float(pose[0, 3]) - 0.2452) < 1e-6
import niryo_jax.hardware
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_importing_the_package_takes_little_longer_than_importing_jax():
    code = """
import sys, time
begin = time.perf_counter()
import jax
middle = time.perf_counter()
before = set(sys.modules)
import niryo_jax
print(middle - begin, time.perf_counter() - middle)
extra = {"pyniryo", "typer", "rich", "scipy", "cv2"} & (set(sys.modules) - before)
sys.exit(f"imported {extra}" if extra else 0)
"""
    done = subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.PIPE)
    jax_seconds, own_seconds = map(float, done.stdout.split())
    print(f"import jax {jax_seconds:.2f} s, then niryo_jax {own_seconds:.2f} s")


@pytest.mark.parametrize("json_flag", [[], ["--json"]])
def test_without_the_extra_one_line_says_what_to_install(json_flag):
    code = """
import sys
sys.modules["typer"] = None
sys.argv[0] = "niryo-jax"
from niryo_jax.cli import main
main()
"""
    done = subprocess.run(
        [sys.executable, "-c", code, "describe", *json_flag], capture_output=True, text=True
    )
    assert done.returncode == 5
    answer = json.loads(done.stdout)["error"] if json_flag else done.stderr
    assert 'pip install "niryo_jax[cli]"' in answer
    assert "Traceback" not in done.stderr


# --- fk


def test_fk_in_degrees_and_in_radians_is_the_same(as_json):
    degrees = ["-10", "-.2e1", "3", "-4", "5", "-6"]
    code, document = as_json("fk", *degrees, "--degrees")
    assert code == 0
    assert document["within_limits"]
    radians = [str(angle) for angle in np.deg2rad([float(word) for word in degrees])]
    assert as_json("fk", *radians, "--radians") == (0, document)
    expected = nj.forward_kinematics(nj.robots.niryo_one(), np.array(document["joints_rad"]))
    np.testing.assert_allclose(document["pose"], expected, rtol=0, atol=1e-15)


def test_fk_shows_metres_and_says_where_joints_are_outside_the_limits(cli):
    code, out, err = cli("fk", "0", "0", "0", "0", "0", "170", "--degrees")
    assert code == 0
    assert "position (m)          0.2452, 0.0, 0.4175\n" in out
    assert "roll pitch yaw (deg)  170.0, 0.0, 0.0\n" in out
    assert "outside the limits" in err


def test_fk_knows_the_other_arms(as_json):
    _, document = as_json("fk", *["0"] * 6, "--radians", "--robot", "niryo_ned2")
    np.testing.assert_allclose(document["position_m"], [0.2952, 0, 0.42905], atol=1e-12)


# --- ik


def test_ik_ranks_and_marks_the_solutions(as_json):
    code, document = as_json("ik", *PICK, "--degrees")
    assert code == 0
    assert document["status"] == "SOLVED"
    assert [s["within_limits"] for s in document["solutions"]] == [True] + [False] * 7
    np.testing.assert_allclose(
        np.rad2deg(document["solutions"][0]["joints_rad"]),
        [-45, -46.8656, -34.8624, 0, -8.2720, -45],
        atol=1e-4,
    )


def test_ik_shows_a_table(cli):
    code, out, _ = cli("ik", *PICK, "--degrees")
    assert code == 0
    assert "-46.87" in out
    assert "At least one solution lies within the joint limits." in out


@pytest.mark.parametrize("kind", ["millimetres", "matrix", "json", "npy"])
def test_ik_takes_a_pose_in_several_ways(as_json, tmp_path, kind):
    _, expected = as_json("ik", *PICK, "--degrees")
    pose = np.array([[0, 0, 1, 0.148], [0, 1, 0, -0.148], [-1, 0, 0, 0.088], [0, 0, 0, 1.0]])
    file = tmp_path / f"pose.{kind}"
    match kind:
        case "millimetres":
            arguments = ["148", "-148", "88", *PICK[3:], "--millimetres"]
        case "matrix":
            arguments = ["--matrix", str(pose.tolist())]
        case "json":
            file.write_text(json.dumps(pose.tolist()))
            arguments = ["--pose-file", str(file)]
        case _:
            np.save(file, pose)
            arguments = ["--pose-file", str(file)]
    _, document = as_json("ik", *arguments, "--degrees")
    np.testing.assert_allclose(
        document["solutions"][0]["joints_rad"], expected["solutions"][0]["joints_rad"], atol=1e-9
    )


def test_ik_explains_the_eight_branches(as_json, cli):
    _, document = as_json("ik", *PICK, "--degrees", "--explain")
    branches = document["branches"]
    assert len(branches) == 8
    for branch in branches:
        assert branch["guess_error_m"] == pytest.approx(5.5e-3, rel=1e-6)
        assert 1 <= branch["newton_iterations"] <= 10
        assert branch["message"].endswith(".")
    assert sorted(branch["solution"] for branch in branches) == list(range(8))
    robot = nj.robots.niryo_one()
    for branch in branches:
        solution = document["solutions"][branch["solution"]]
        assert (branch["outcome"] == "SOLVED") == solution["within_limits"]
        reached = nj.newton_raphson(robot, np.array(document["pose"]), branch["guess_rad"]).q
        turns = (np.asarray(reached) - solution["joints_rad"]) / (2 * np.pi)
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
    _, out, _ = cli("ik", *PICK, "--degrees", "--explain")
    assert "5.500" in out


def test_ik_explains_dropped_branches_too(as_json):
    code, document = as_json("ik", *UNREACHABLE, "--radians", "--explain")
    assert code == 3
    assert {branch["outcome"] for branch in document["branches"]} == {"NO_GUESS"}
    assert {branch["solution"] for branch in document["branches"]} == {None}


def test_ik_reports_that_a_rounded_pose_was_projected(as_json, cli):
    rounded = ["--matrix", "0.54 0 0.841 0.091039 0 1 0 0 -0.841 0 0.54 0.190529"]
    _, document = as_json("ik", *rounded, "--radians")
    assert document["pose_distance"] == pytest.approx(7.9e-4, rel=1e-2)
    assert "7.9e-04" in cli("ik", *rounded, "--radians")[2]


def test_ik_without_a_solution_ends_with_3_and_its_sentence(as_json, cli):
    code, document = as_json("ik", *UNREACHABLE, "--radians")
    assert code == document["exit_code"] == 3
    assert document["status"] == "UNREACHABLE"
    code, out, err = cli("ik", *UNREACHABLE, "--radians")
    assert (code, out) == (3, "")
    assert err.startswith("error: The pose cannot be reached")


# --- wrong arguments


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["fk", *["0"] * 6], "--degrees or --radians"),
        (["fk", "0", "0", "--degrees"], "expected 6 finite angles"),
        (["fk", *["0"] * 5, "nan", "--degrees"], "expected 6 finite angles"),
        (["fk", *["0"] * 6, "--degree"], "expected a number, got '--degree'"),
        (["ik", *PICK], "--degrees or --radians"),
        (["ik", "--degrees"], "give the pose in one way"),
        (["ik", *PICK, "--matrix", "1", "--degrees"], "give the pose in one way"),
        (["ik", "0.1", "0.2", "0.3", "--degrees"], "three lengths"),
        (["ik", "0.1", "0.2", "--rpy", "0", "0", "0", "--degrees"], "3 finite lengths, got 2"),
        (["ik", "nan", "0", "0", "--rpy", "0", "0", "0", "--degrees"], "got 3: nan 0 0"),
        (["ik", "1", "0", "0", "--rpy", "0", "1e400", "0", "--degrees"], "got 3: 0 inf 0"),
        (["ik", "--matrix", "nan 0 0 0 0 1 0 0 0 0 1 0", "--degrees"], "not a rigid motion"),
        (["fk", "1e300", *["0"] * 5, "--degrees"], "angles that have a sine"),
        (["fk", "1_0", *["0"] * 5, "--degrees"], "got '1_0'"),
        (["fk", "", "--degrees"], "got 0: none"),
        (["fk", *["0"] * 6, "--degrees", "--robot", ""], "'' is neither"),
        (["fk", *["0"] * 6, "--degrees", "--robot", "/"], "'/' is a directory"),
        (["fk", *["0"] * 6, "--degrees", "--robot", "a" * 5000], "is neither"),
        (["pick-and-place", "--speed", "fast"], "got 'fast'"),
        (["pick-and-place", "--robot", "abb_irb120"], "is no Niryo arm"),
        (["pick-and-place", "--speed=1000"], "got '1000'"),
        (["ik", "--matrix", "1 2 3", "--degrees"], "expected 16 numbers"),
        (["ik", "--matrix", "1 2 x", "--degrees"], "'x'"),
        (["ik", "--matrix", "2 0 0 0 0 2 0 0 0 0 2 0", "--degrees"], "not a rigid motion"),
        (["ik", "--pose-file", "absent.json", "--degrees"], "absent.json cannot be read"),
        (["pick-and-place", "--speed", "0"], "--speed"),
        (["pick-and-place", "--tool", "hand"], "gripper_1"),
        (["pick-and-place", "--host", "x", "--time-scale", "2"], "--time-scale"),
        (["describe", "--robot", "puma"], "puma"),
        (["dance"], "dance"),
        ([], "command"),
    ],
)
def test_wrong_arguments_end_with_2_and_one_sentence(cli, as_json, arguments, sentence):
    code, out, err = cli(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert sentence.lower() in err.lower()
    if arguments:
        code, document = as_json(*arguments)
        assert code == document["exit_code"] == 2
        assert sentence.lower() in document["error"].lower()


def test_help_names_the_exit_codes(cli):
    code, out, _ = cli("--help")
    assert code == 0
    for line in ("0  done", "3  no joint angles", "5  an optional package", "130  interrupted"):
        assert line in out


def test_an_unexpected_error_ends_with_1_and_without_a_traceback(cli, monkeypatch):
    def broken(*_: object) -> None:
        raise RuntimeError("the dog ate it")

    monkeypatch.setattr("niryo_jax.cli.kinematics.forward_kinematics", broken)
    code, _, err = cli("fk", *["0"] * 6, "--degrees")
    assert code == 1
    assert err.startswith("error: unexpected RuntimeError: the dog ate it")
    assert "Traceback" not in err
    monkeypatch.setenv("NIRYO_JAX_DEBUG", "1")
    assert "Traceback" in cli("fk", *["0"] * 6, "--degrees")[2]


def test_version_and_describe(cli, as_json):
    assert cli("--version")[:2] == (0, f"niryo_jax {nj.__version__}\n")
    assert "niryo_ned" in cli("describe", "--robot", "niryo_ned")[1]
    code, document = as_json("describe")
    assert code == 0
    assert document["description"] == nj.robots.niryo_one().describe()


# --- pick-and-place


def test_dry_run_prints_the_plan_and_needs_no_pyniryo(as_json, cli, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyniryo", None)
    code, document = as_json("pick-and-place", "--dry-run")
    assert code == document["steps_done"] == 0
    steps = document["steps"]
    assert [step["step"] for step in steps] == list(range(1, 11))
    moves = [step for step in steps if step["action"] == "move"]
    assert [step["speed_percent"] for step in moves] == [70, 70, 30, 30, 30, 30, 70, 70]
    robot = nj.robots.niryo_one()
    for step in moves:
        reached = np.asarray(nj.forward_kinematics(robot, np.array(step["joints_sent_rad"])))
        np.testing.assert_allclose(reached[:3, 3], step["target_position_m"], atol=1e-9)
        assert step["planned_error_m"] <= 1e-9
    code, out, err = cli("pick-and-place", "--dry-run", "--speed", "20")
    assert code == 0
    assert out.count("20 %") == 8
    assert "-46.87" in out
    assert "7.9e-04" in err


def test_a_pose_out_of_reach_ends_with_3(cli, monkeypatch):
    # As printed, the start is that of the Niryo One, outside the limits of the other arms.
    monkeypatch.setattr("niryo_jax.cli.pick_and_place.steps_for", lambda _: TABLE_2_1)
    code, _, err = cli("pick-and-place", "--dry-run", "--robot", "niryo_ned2")
    assert code == 3
    assert err.startswith("error: step 1 (Starting position) of niryo_ned2: The pose can be")


@pytest.mark.parametrize("name", ["niryo_ned", "niryo_ned2"])
def test_the_other_arms_have_a_plan_inside_their_limits(as_json, name):
    code, document = as_json("pick-and-place", "--dry-run", "--robot", name)
    assert (code, document["robot"]) == (0, name)
    robot = nj.robots.load(name)
    for step in document["steps"]:
        if step["action"] == "move":
            q = np.array(step["joints_sent_rad"])
            assert np.all((robot.lower <= q) & (q <= robot.upper))
            reached = np.asarray(nj.forward_kinematics(robot, q))
            np.testing.assert_allclose(reached, step["target_pose"], atol=1e-8)


@needs_pyniryo
@pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning")
def test_an_address_where_no_robot_is_is_named_before_anything_is_solved(cli, monkeypatch):
    monkeypatch.setattr("niryo_jax.cli.pick_and_place.plan", None)
    for host in ("", "robot:", "robot:http", "robot:70000"):
        code, _, err = cli("pick-and-place", "--host", host)
        assert code == 2
        assert "host: expected" in err
    for host, words in (("127.0.0.1:1", "refused"), ("no-such-host.invalid", "cannot be reached")):
        code, _, err = cli("pick-and-place", "--host", host)
        assert code == 4
        assert words in err


@needs_pyniryo
@pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning")
class TestPickAndPlace:
    def test_the_simulated_robot_does_it(self, cli):
        code, out, err = cli("pick-and-place", "--time-scale", "50")
        assert code == 0
        assert "The object is at (148.0, 148.0, 0.0) mm." in out
        assert "Return to the" in out
        assert "10/10  Return to the start" in err

    def test_as_json(self, as_json):
        code, document = as_json("pick-and-place", "--time-scale", "50")
        assert code == 0
        np.testing.assert_allclose(document["object_position_m"], OBJECT_END, atol=1e-6)
        assert document["steps_done"] == 10
        for step in document["steps"]:
            assert step["seconds"] >= 0
            if step["action"] == "move":
                assert step["reached_error_m"] <= 0.5e-3
                np.testing.assert_allclose(
                    step["joints_read_rad"], step["joints_sent_rad"], atol=1e-6
                )

    def test_a_robot_that_stops_ends_with_4_and_the_steps_so_far(self, cli, as_json):
        fault = Fault(FaultKind.REFUSE, "MOVE_JOINTS", occurrence=3, message="Collision")
        with SimulatedNiryo(time_scale=50.0, faults=[fault]) as simulated:
            code, document = as_json("pick-and-place", "--host", simulated.address)
        assert code == document["exit_code"] == 4
        assert document["error"] == "the robot refused move_joints: Collision"
        assert document["steps_done"] == 2
        assert "joints_read_rad" in document["steps"][1]
        with SimulatedNiryo(time_scale=50.0, faults=[fault]) as simulated:
            code, out, err = cli("pick-and-place", "--host", simulated.address)
        assert code == 4
        assert "Approach above" in out
        assert err.endswith("error: the robot refused move_joints: Collision\n")

    def test_another_arm_than_that_of_the_plan_ends_with_4_and_nothing_moves(self, cli):
        with SimulatedNiryo(MODELS["niryo_ned2"], time_scale=50.0) as simulated:
            code, out, err = cli("pick-and-place", "--host", simulated.address)
            assert (code, out) == (4, "")
            assert "is a niryo_ned2; expected a niryo_one" in err
            assert not np.any(simulated.arm.joints)
            options = ("--host", simulated.address, "--robot", "niryo_ned2")
            code, _, err = cli("pick-and-place", *options)
            assert code == 0, err

    @pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
    @pytest.mark.parametrize("as_document", [False, True])
    def test_ctrl_c_says_what_was_done_and_ends_with_130(self, as_document):
        options = ["--json"] if as_document else []
        with start("pick-and-place", *options, stderr=subprocess.PIPE) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            for line in process.stderr:
                if " 2/10" in line:
                    process.send_signal(signal.SIGINT)
                    break
            out, err = process.communicate(timeout=60)
        assert process.returncode == 130
        words = "interrupted after 2 of 10 steps"
        if as_document:
            document = json.loads(out)
            assert document["error"].startswith(words)
            assert document["exit_code"] == 130
            assert document["steps_done"] == 2
            assert "joints_read_rad" in document["steps"][1]
            assert "joints_read_rad" not in document["steps"][2]
        else:
            assert "Approach above" in out
            assert f"error: {words}" in err

    def test_nobody_there_ends_with_4(self, cli):
        code, out, err = cli("pick-and-place", "--host", "127.0.0.1:1")
        assert (code, out) == (4, "")
        assert "127.0.0.1:1 refused the connection" in err

    @pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
    def test_a_robot_simulated_by_another_process_does_it(self, as_json):
        with start("simulate", "--port", "0", "--time-scale", "50", "--json") as process:
            try:
                assert process.stdout is not None
                lines = [process.stdout.readline() for _ in range(4)]
                address = json.loads("".join(lines))["address"]
                code, document = as_json("pick-and-place", "--host", address)
                assert (code, document["steps_done"]) == (0, 10)
            finally:
                process.send_signal(signal.SIGINT)
            assert process.wait(timeout=10) == 0

    def test_a_missing_pyniryo_ends_with_5(self, cli, monkeypatch):
        def absent(_: str) -> str:
            raise importlib.metadata.PackageNotFoundError

        monkeypatch.setattr("importlib.metadata.version", absent)
        code, _, err = cli("pick-and-place")
        assert code == 5
        assert 'pip install "niryo_jax[robot]"' in err


# --- simulate, and the command as installed


def test_simulate_says_where_it_listens_and_where_the_object_is():
    with start("simulate", "--port", "0", "--object", "0.1", "-0.2") as process:
        assert process.stdout is not None
        assert "listens on 127.0.0.1:" in process.stdout.readline()
        assert "niryo-jax pick-and-place --host 127.0.0.1:" in process.stdout.readline()
        time.sleep(0.2)
        process.terminate()
        assert process.wait(timeout=10) == 0
        assert "The object is at (100.0, -200.0, 0.0) mm." in process.stdout.read()


def test_simulate_on_a_taken_port_ends_with_4(as_json):
    with SimulatedNiryo() as simulated:
        code, document = as_json("simulate", "--port", str(simulated.port))
    assert code == document["exit_code"] == 4
    assert f"cannot listen on 127.0.0.1:{simulated.port}" in document["error"]


def test_the_command_chooses_float64_and_the_cpu_by_itself():
    with start("fk", *["0.1"] * 6, "--radians", "--json") as process:
        out, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    expected = nj.forward_kinematics(nj.robots.niryo_one(), np.full(6, 0.1))
    np.testing.assert_allclose(json.loads(out)["pose"], expected, rtol=0, atol=1e-15)
