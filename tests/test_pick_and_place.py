"""Table 2.1 end to end: solved in one batch, executed through pyniryo on the simulated robot."""

from __future__ import annotations

import importlib.util
import itertools
import json

import numpy as np
import pytest
from support import DATA

import niryo_jax as nj
from niryo_jax.hardware import Fault, FaultKind, MotionNotReached, NiryoArm, SimulatedNiryo
from niryo_jax.hardware.pick_and_place import (
    AT_REST,
    OBJECT_END,
    OBJECT_START,
    TABLE_2_1,
    Step,
    StepRecord,
    StepUnsolvable,
    execute,
    plan,
    steps_for,
)

# The joint vectors inside the limits, degrees, as published; steps 4 and 8 do not move.
JOINTS = {
    1: (0, 17.1887, -74.4845, 0, 0, 0),
    2: (-45, -29.0303, -38.3463, 0, -22.6234, -45),
    3: (-45, -46.8656, -34.8624, 0, -8.2720, -45),
    6: (45, -29.0303, -38.3463, 0, -22.6234, 45),
    7: (45, -46.8656, -34.8624, 0, -8.2720, 45),
}
SAME_AS = {4: 3, 5: 2, 8: 7, 9: 6, 10: 1}
MOVES = [number for number, step in enumerate(TABLE_2_1, start=1) if step.action == "move"]

needs_pyniryo = pytest.mark.skipif(
    importlib.util.find_spec("pyniryo") is None, reason="pyniryo is not installed"
)


@pytest.fixture(scope="module")
def planned():
    return plan(nj.robots.niryo_one())


@pytest.fixture(scope="module")
def executed(planned):
    with SimulatedNiryo(time_scale=50.0) as simulated:
        simulated.place_object(OBJECT_START)
        with NiryoArm(simulated.address, robot=planned.robot) as arm:
            arm.calibrate()
            arm.use_tool("gripper_1")
            arm.release()
            records = execute(planned, arm)
        yield records, simulated


def exact_cases():
    cases = json.loads((DATA / "niryo_one_ik.json").read_text())["cases"]
    return [case for case in cases if case["tag"].startswith("Table 2.1")]


def test_the_table_has_ten_steps_and_five_distinct_poses():
    assert len(TABLE_2_1) == 10
    assert len({step.pose.tobytes() for step in TABLE_2_1 if step.pose is not None}) == 5
    assert [step.action for step in TABLE_2_1].count("move") == 8
    assert {step.percent for step in TABLE_2_1} == {30, 70}


@pytest.mark.parametrize("name", ["niryo_ned", "niryo_ned2"])
def test_other_arms_start_from_their_own_rest_and_do_the_rest_of_the_table(name):
    robot = nj.robots.load(name)
    steps = steps_for(robot)
    assert steps[1:9] == TABLE_2_1[1:9]
    rest = np.asarray(nj.forward_kinematics(robot, np.array(AT_REST)))
    for step in (steps[0], steps[9]):
        np.testing.assert_allclose(step.pose, rest, rtol=0, atol=1e-15)
    solved = plan(robot, steps).steps
    np.testing.assert_allclose(solved[0].joints, AT_REST, atol=1e-8)
    with pytest.raises(StepUnsolvable, match=rf"step 1 \(Starting position\) of {name}"):
        plan(robot)


def test_the_steps_of_the_niryo_one_are_those_of_the_table():
    assert steps_for(nj.robots.niryo_one()) is TABLE_2_1


def test_exact_poses_have_the_published_solutions():
    cases = exact_cases()
    steps = [Step(case["tag"], pose=np.array(case["pose"])) for case in cases]
    assert len(steps) == 5
    for case, solved in zip(cases, plan(nj.robots.niryo_one(), steps).steps):
        (expected,) = np.array(case["solutions"])[case["inside_limits"]]
        np.testing.assert_allclose(solved.joints, expected, rtol=0, atol=1e-9)


def test_every_step_has_the_published_joints(planned):
    for number, step in enumerate(planned.steps, start=1):
        expected = JOINTS[SAME_AS.get(number, number)]
        # Three decimals in the printed start pose are worth 1e-3 degrees.
        np.testing.assert_allclose(np.rad2deg(step.joints), expected, atol=1e-3)


def test_every_pose_is_solved_tightly_hover_poses_too(planned):
    for number in MOVES:
        step = planned.steps[number - 1]
        reached = np.asarray(nj.forward_kinematics(planned.robot, step.joints))
        np.testing.assert_allclose(reached[:3, 3], step.step.pose[:3, 3], rtol=0, atol=1e-9)
        assert step.position_error <= 1e-9


def test_the_pose_printed_with_three_decimals_is_accepted_and_its_distance_reported(planned):
    distances = [planned.steps[number - 1].pose_distance for number in MOVES]
    assert distances[0] == distances[-1] == pytest.approx(7.91e-4, rel=1e-2)
    assert max(distances[1:-1]) <= 1e-15


def test_the_way_between_steps_stays_within_the_limits(planned):
    robot, share = planned.robot, np.linspace(0, 1, 11)[:, None]
    stops = [np.zeros(6), *(step.joints for step in planned.steps)]
    for start, goal in itertools.pairwise(stops):
        way = start + share * (goal - start)
        assert np.all((robot.lower <= way) & (way <= robot.upper))


def test_a_step_takes_the_solution_nearest_to_the_one_before():
    robot = nj.robots.niryo_one()
    q = np.array([0.4, -0.3, -0.2, 0.6, 0.5, -2.0])
    pose = np.asarray(nj.forward_kinematics(robot, q))
    others = nj.inverse_kinematics(robot, pose[None])
    assert int(np.sum(others.within_limits)) > 1
    for wanted in np.asarray(others.q)[np.asarray(others.within_limits)]:
        solved = plan(robot, [Step("there", pose=pose)], q_start=wanted + 0.01)
        np.testing.assert_allclose(solved.steps[0].joints, wanted, atol=1e-9)


def test_a_speed_replaces_that_of_every_move():
    assert {step.step.percent for step in plan(nj.robots.niryo_one(), percent=15).steps} == {15}


def test_a_step_out_of_reach_is_named_with_the_reason():
    far = np.eye(4)
    far[0, 3] = 2.0
    steps = [TABLE_2_1[3], Step("Fly away", pose=far)]
    with pytest.raises(StepUnsolvable, match=r"step 2 \(Fly away\).*cannot be reached"):
        plan(nj.robots.niryo_one(), steps)


@needs_pyniryo
@pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning")
class TestExecuted:
    def test_the_object_ends_at_its_destination(self, executed):
        _, simulated = executed
        np.testing.assert_allclose(simulated.object_position, OBJECT_END, rtol=0, atol=1e-6)
        assert not simulated.arm.holding

    def test_every_target_is_reached(self, executed, planned):
        records, _ = executed
        assert len(records) == 10
        for number in MOVES:
            record = records[number - 1]
            assert record.position_error <= 0.5e-3
            np.testing.assert_allclose(record.reached, planned.steps[number - 1].joints, atol=1e-6)
            assert record.seconds > 0
        assert records[3].position_error is records[7].position_error is None

    def test_it_returns_to_the_start(self, executed):
        records, simulated = executed
        np.testing.assert_array_equal(records[9].planned.joints, records[0].planned.joints)
        np.testing.assert_allclose(simulated.arm.joints, records[0].reached, atol=1e-6)

    def test_the_robot_was_told_the_speeds_of_the_plan(self, executed):
        _, simulated = executed
        speeds = [r.params[0] for r in simulated.received if r.command == "SET_ARM_MAX_VELOCITY"]
        assert speeds == [70, 70, 30, 30, 30, 30, 70, 70]

    def test_a_robot_that_does_not_move_ends_it_with_the_steps_so_far(self, planned):
        done: list[StepRecord] = []
        with (
            SimulatedNiryo(time_scale=1000.0) as simulated,
            NiryoArm(simulated.address, robot=planned.robot, settle=0.0) as arm,
        ):
            arm.calibrate()
            arm.use_tool("gripper_1")
            simulated.inject(Fault(FaultKind.STILL, "MOVE_JOINTS", occurrence=3))
            with pytest.raises(MotionNotReached):
                execute(planned, arm, done.append)
        assert [record.planned.step.title for record in done] == [s.title for s in TABLE_2_1[:2]]
