"""`niryo-jax ik --task`: a part of a pose, and what is said of it."""

from __future__ import annotations

import re

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("rich")

import niryo_jax as nj
from niryo_jax.cli.options import TaskChoice
from niryo_jax.ik.task import BOUND

PLACE = ["0.2", "0.1", "0.25"]
POSE = [*PLACE, "--rpy", "0", "45", "30", "--degrees"]
ALONG = ["--task", "direction", "--tool-axis", "1", "0", "0"]


def test_the_tasks_are_those_of_the_package():
    assert [choice.value for choice in TaskChoice] == list(BOUND)


@pytest.mark.parametrize(
    ("options", "axis", "free", "complete"),
    [
        (ALONG, (1, 0, 0), ["joint_6"], True),
        (["--task", "direction", "--tool-axis", "-2", "0", "0"], (-2, 0, 0), ["joint_6"], True),
        (["--task", "direction"], (0, 0, 1), [], False),
        (["--task", "position"], None, ["joint_6"], False),
    ],
)
def test_a_part_of_a_pose_is_solved_as_in_python(as_json, options, axis, free, complete):
    code, document = as_json("ik", *POSE, *options)
    assert code == 0
    task = options[1]
    assert (document["task"], document["bound"]) == (task, BOUND[task][1])
    assert document.get("tool_axis") == (None if axis is None else list(axis))
    assert (document["free_joints"], document["complete"]) == (free, complete)
    robot = nj.robots.niryo_one()
    pose = np.array(document["pose"])
    q = np.array([solution["joints_rad"] for solution in document["solutions"]])
    reached = np.asarray(nj.forward_kinematics(robot, q))
    metres = np.linalg.norm((reached - pose)[:, :3, 3], axis=1)
    for solution, away in zip(document["solutions"], metres):
        assert away < 1e-10
        assert solution["position_error_m"] == pytest.approx(away, abs=1e-14)
        if task == "position":
            assert solution["rotation_error_rad"] is None
        else:
            assert solution["rotation_error_rad"] < 1e-10
    for name in free:
        joint = robot.joint_names.index(name)
        halfway = 0.5 * (robot.lower + robot.upper)[joint]
        np.testing.assert_allclose(q[:, joint], halfway, atol=1e-12)
    if task == "direction":
        seen = (reached - pose)[:, :3, :3] @ (np.array(axis) / np.linalg.norm(axis))
        assert np.abs(seen).max() < 1e-10
    options = {} if axis is None else {"tool_axis": axis}
    expected = nj.inverse_kinematics(robot, pose, task=task, **options)
    np.testing.assert_array_equal(q, np.asarray(expected.q)[np.asarray(expected.found)])


def test_the_whole_pose_is_the_task_unless_said(as_json):
    code, document = as_json("ik", *POSE)
    assert (code, document["task"], document["free_joints"]) == (0, "pose", [])
    assert as_json("ik", *POSE, "--task", "pose") == (0, document)
    assert "tool_axis" not in document


def test_a_position_needs_no_angles(as_json):
    _, document = as_json("ik", *PLACE, "--degrees", "--task", "position")
    assert document["status"] == "SOLVED"
    np.testing.assert_allclose(np.array(document["pose"])[:3, 3], [0.2, 0.1, 0.25])
    turned = as_json("ik", *POSE, "--task", "position")[1]
    assert len(turned["solutions"]) == len(document["solutions"])


def test_the_table_says_what_was_bound_and_how_complete_it_is(cli):
    code, out, err = cli("ik", *POSE, *ALONG)
    assert (code, err) == (0, "")
    assert "axis off by (rad)" in out
    assert "Bound: position and direction of the tool axis. These solutions are all" in out
    assert "Of no matter, and halfway in the range: joint_6." in out
    assert re.search(r"Within .* m and .* rad of the position and direction of the tool axis", out)
    code, out, err = cli("ik", *POSE, "--task", "position")
    assert (code, err) == (0, "")
    assert "rad)" not in out.replace("All digits", "")
    assert "Bound: position. These solutions are some of those that there may be." in out
    assert "There may be more solutions than were found." in out
    _, out, _ = cli("ik", *POSE)
    assert "Bound" not in out


@pytest.mark.parametrize("task", ["direction", "position"])
def test_what_cannot_be_reached_ends_with_3_and_says_what_was_asked_for(as_json, cli, task):
    code, document = as_json("ik", "5", "0", "0", *POSE[3:], "--task", task)
    assert code == document["exit_code"] == 3
    assert (document["task"], document["solutions"]) == (task, [])
    code, out, err = cli("ik", "5", "0", "0", *POSE[3:], "--task", task)
    assert (code, out) == (3, "")
    assert f"Asked for: {BOUND[task][1]}." in err


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--task", "axis"], "'axis' is not one of 'pose', 'direction', 'position'"),
        (["--tool-axis", "1", "0", "0"], "--tool-axis goes with --task direction, got --task pose"),
        (["--task", "position", "--tool-axis", "1", "0", "0"], "got --task position"),
        (["--task", "direction", "--tool-axis", "0", "0", "0"], "expected a direction, got 0 0 0"),
        (["--task", "direction", "--tool-axis", "1", "0", "x"], "expected a number, got 'x'"),
        (["--task", "direction", "--tool-axis", "1", "0", "nan"], "3 finite numbers, got 3"),
        (["--task", "direction", "--tool-axis", "1", "0"], "requires 3 arguments"),
        (["--task", "position", "--explain"], "--explain goes with --task pose"),
    ],
)
def test_wrong_tasks_end_with_2_and_one_sentence(cli, as_json, options, sentence):
    code, out, err = cli("ik", *POSE, *options)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert sentence.lower() in err.lower()
    assert len(err.splitlines()) == 1
    code, document = as_json("ik", *POSE, *options)
    assert code == document["exit_code"] == 2
    assert "three lengths and three angles" in as_json("ik", *PLACE, "--degrees")[1]["error"]
