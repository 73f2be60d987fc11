"""Table 2.1 as one timed trajectory: its limits, lines and clearance; on the simulated robot."""

from __future__ import annotations

import dataclasses
import importlib.util
import itertools
import threading
import time

import numpy as np
import pytest

import niryo_jax as nj
from niryo_jax import collision as co
from niryo_jax import motion, studies
from niryo_jax.hardware import (
    CommandRefused,
    ExecutionAborted,
    ExecutionState,
    Fault,
    FaultKind,
    MotionStopped,
    NiryoArm,
    SimulatedNiryo,
)
from niryo_jax.hardware.pick_and_place import (
    OBJECT_END,
    OBJECT_START,
    TABLE_2_1,
    StepUnsolvable,
    plan,
    steps_for,
)
from niryo_jax.hardware.plan_clearance import StepCollides, check_approach
from niryo_jax.studies.sections import sections

needs_pyniryo = [
    pytest.mark.skipif(
        importlib.util.find_spec("pyniryo") is None, reason="pyniryo is not installed"
    ),
    pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning"),
]

NIRYO = nj.robots.niryo_one()
ARMS = ["niryo_one", "niryo_ned", "niryo_ned2"]
LINES, GRIPS = [3, 5, 7, 9], [4, 8]
LINE_COMMAND = "EXECUTE_TRAJECTORY_FROM_POSES_AND_JOINTS"
GRIPPER = {f"{word}_GRIPPER" for word in ("OPEN", "CLOSE")}
MOVING = {"MOVE_JOINTS", LINE_COMMAND, "GRASP_WITH_TOOL", "RELEASE_WITH_TOOL", *GRIPPER}


def made(name):
    robot = nj.robots.load(name)
    return studies.timed_plan(plan(robot, steps_for(robot)))


@pytest.fixture(scope="module")
def timed():
    return made("niryo_one")


@pytest.fixture(scope="module", params=ARMS)
def any_timed(request, timed):
    return timed if request.param == "niryo_one" else made(request.param)


def check_of(robot, height=0.0, **obstacles):
    model = co.shipped(robot, "gripper_1")
    return co.CollisionCheck(model, co.World.table(height), **obstacles)


@pytest.fixture(scope="module")
def found(timed):
    return studies.check_timed(timed, check_of(NIRYO))


def samples(timed, number):
    """Those of a step, by its number from 1, its begin and its end included."""
    step = timed.steps[number - 1]
    return (np.asarray(x)[step.first : step.last + 1] for x in timed.trajectory)


def poses(timed, q):
    return np.asarray(nj.forward_kinematics(timed.plan.robot, q))


class TestTrajectory:
    def test_it_goes_through_all_steps_in_time(self, any_timed):
        timed = any_timed
        trajectory = timed.trajectory
        k = len(trajectory.time)
        assert [np.shape(x) for x in trajectory] == [(k,), (k, 6), (k, 6), (k, 6)]
        assert trajectory.time[0] == 0
        assert trajectory.time[-1] == timed.duration
        assert np.all(np.diff(trajectory.time) > 0)
        assert np.max(np.diff(trajectory.time)) < 0.01 + 1e-9
        before = timed.steps[0]
        assert (before.begin, before.end, before.first, before.last) == (0, 0, 0, 0)
        for planned, step in zip(timed.plan.steps[1:], timed.steps[1:]):
            assert (step.begin, step.first) == (before.end, before.last)
            assert (trajectory.time[step.first], trajectory.time[step.last]) == (
                step.begin,
                step.end,
            )
            np.testing.assert_allclose(trajectory.q[step.last], planned.joints, atol=1e-12)
            before = step
        ways = ["start", "free", "line", "rest", "line", "free", "line", "rest", "line", "free"]
        assert [step.way for step in timed.steps] == ways
        assert [step.rests for step in timed.steps] == [
            i in (1, 3, 4, 7, 8, 10) for i in range(1, 11)
        ]

    def test_speeds_are_those_of_the_steps_and_accelerations_those_of_the_arm(self, any_timed):
        timed, limits = any_timed, motion.niryo_limits(any_timed.plan.robot.name)
        most = []
        for number, planned in enumerate(timed.plan.steps, start=1):
            when, q, velocity, acceleration = samples(timed, number)
            share = planned.step.percent / 100
            assert np.all(np.abs(velocity) <= share * limits.velocity * (1 + 1e-4))
            assert np.all(np.abs(acceleration) <= limits.acceleration * (1 + 1e-6))
            span = np.diff(when)[:, None]
            if len(span):
                rate, push = np.diff(q, axis=0) / span, np.diff(velocity, axis=0) / span
                assert np.all(np.abs(rate) <= share * limits.velocity * (1 + 1e-4))
                assert np.all(np.abs(push) <= limits.acceleration * (1 + 1e-4))
                most.append(np.max(np.abs(acceleration) / limits.acceleration))
        # It is as fast as they allow.
        assert max(most) > 0.999

    def test_rates_are_those_of_the_joints_and_nothing_jumps(self, any_timed):
        when, q, velocity = map(np.asarray, any_timed.trajectory[:3])
        span = np.diff(when)[:, None]
        trapezoid = span * (velocity[1:] + velocity[:-1]) / 2
        pushed = motion.niryo_limits(any_timed.plan.robot.name).acceleration
        assert np.all(np.abs(np.diff(q, axis=0) - trapezoid) <= pushed * span**2)
        assert np.max(np.abs(np.diff(q, axis=0) - trapezoid)) < 1e-4

    def test_the_arm_rests_where_the_gripper_acts(self, any_timed):
        for number in GRIPS:
            when, q, velocity, acceleration = samples(any_timed, number)
            assert when[-1] - when[0] == pytest.approx(1.0)
            assert not np.any(velocity)
            assert not np.any(acceleration)
            np.testing.assert_array_equal(q, np.broadcast_to(q[0], q.shape))
        for end in (0, -1):
            assert not np.any(any_timed.trajectory.velocity[end])

    def test_each_step_ends_at_its_pose_without_a_halt_where_there_is_no_grip(self, any_timed):
        for planned, step in zip(any_timed.plan.steps, any_timed.steps):
            if planned.step.pose is None:
                continue
            reached = poses(any_timed, any_timed.trajectory.q[step.last])
            np.testing.assert_allclose(reached[:3, 3], planned.step.pose[:3, 3], atol=1e-9)
            # The start is printed with three decimals.
            np.testing.assert_allclose(reached, planned.step.pose, atol=1e-3)
            speed = np.max(np.abs(any_timed.trajectory.velocity[step.last]))
            assert (speed == 0) == step.rests
            assert step.rests or speed > 0.05

    def test_descents_and_lifts_are_vertical(self, any_timed):
        for number in LINES:
            _, q, *_ = samples(any_timed, number)
            tool, pose = poses(any_timed, q), any_timed.plan.steps[number - 1].step.pose
            np.testing.assert_allclose(tool[:, :2, 3], np.tile(pose[:2, 3], (len(q), 1)), atol=1e-9)
            np.testing.assert_allclose(
                tool[:, :3, :3], np.tile(pose[:3, :3], (len(q), 1, 1)), atol=1e-9
            )
            height = tool[:, 2, 3]
            assert np.all(np.diff(height) * np.sign(height[-1] - height[0]) > 0)
            assert np.min(height) >= 0.088 - 1e-9
            assert np.max(height) <= 0.150 + 1e-9

    def test_the_free_ways_stay_above_and_swing_out_by_little(self, any_timed):
        for number in (2, 6, 10):
            _, q, *_ = samples(any_timed, number)
            height = poses(any_timed, q)[:, 2, 3]
            assert np.min(height) > 0.150 - 1e-6
            assert np.max(height) < 0.25
        _, q, *_ = samples(any_timed, 6)
        assert np.max(poses(any_timed, q)[:, 2, 3]) < 0.175

    def test_it_is_clear(self, any_timed):
        check = check_of(any_timed.plan.robot)
        assert np.min(studies.check_timed(any_timed, check).clearance) > 0.0028

    def test_it_is_faster_than_halting_at_every_step(self, timed):
        limits = motion.niryo_limits()
        halting = 2.0
        stops = [step.joints for step in timed.plan.steps]
        for planned, start, end in zip(timed.plan.steps[1:], stops, stops[1:]):
            bound = limits.scaled(planned.step.percent / 100)
            halting += float(motion.point_to_point(start, end, bound, straight=True).duration)
        assert timed.duration < halting


class TestOtherPlans:
    def test_options(self, timed):
        other = studies.timed_plan(
            timed.plan, motion.niryo_limits().scaled(1, 2), dwell=0.0, step=0.05
        )
        assert other.duration < timed.duration - 2
        assert np.max(np.diff(other.trajectory.time)) < 0.05 + 1e-9
        assert np.all(np.diff(other.trajectory.time) > 0)
        assert [step.end - step.begin for step in other.steps if step.way == "rest"] == [0, 0]

    def test_lines_that_meet_have_a_rest_between_and_moves_to_where_it_stands_take_no_time(self):
        above, low = TABLE_2_1[1], TABLE_2_1[2]
        steps = [TABLE_2_1[0], above, low, above, above, TABLE_2_1[5], TABLE_2_1[9]]
        timed = studies.timed_plan(plan(NIRYO, steps))
        assert [step.way for step in timed.steps] == [
            "start",
            "free",
            "line",
            "line",
            "rest",
            "free",
            "free",
        ]
        assert [step.rests for step in timed.steps] == [True, False, True, True, True, False, True]
        assert timed.steps[4].end == timed.steps[4].begin
        # From one free way to the next it goes on.
        assert np.max(np.abs(timed.trajectory.velocity[timed.steps[5].last])) > 0.05
        assert np.all(np.diff(timed.trajectory.time) > 0)
        assert timed.motions == ((1, 2), (3, 3), (5, 6))

    def test_one_step_alone_is_a_place(self, timed):
        alone = studies.timed_plan(dataclasses.replace(timed.plan, steps=timed.plan.steps[:1]))
        assert alone.duration == 0
        assert alone.trajectory.q.shape == (1, 6)
        assert studies.check_timed(alone, check_of(NIRYO)).clearance.shape == (1,)

    def test_what_cannot_be_timed_is_named(self, timed):
        steps = list(timed.plan.steps)
        steps[2] = dataclasses.replace(steps[2], joints=steps[6].joints)
        with pytest.raises(
            StepUnsolvable, match=r"^step 3 \(Descent to the object\).*other joints"
        ):
            studies.timed_plan(dataclasses.replace(timed.plan, steps=tuple(steps)))
        with pytest.raises(ValueError, match="plan: expected one step or more"):
            studies.timed_plan(dataclasses.replace(timed.plan, steps=()))
        with pytest.raises(ValueError, match="limits: expected those of 6 joints, got 5"):
            studies.timed_plan(timed.plan, motion.MotionLimits(*np.ones((2, 5))))
        other = dataclasses.replace(NIRYO, name="another")
        with pytest.raises(ValueError, match="limits: expected those of another"):
            studies.timed_plan(dataclasses.replace(timed.plan, robot=other))
        for options, word in (({"dwell": -1}, "dwell"), ({"step": 0}, "step")):
            with pytest.raises(ValueError, match=f"^{word}: "):
                studies.timed_plan(timed.plan, **options)

    def test_a_line_across_a_limit_is_named(self, timed):
        lower = np.array(NIRYO.lower)
        lower[1] = np.deg2rad(-40)
        narrow = dataclasses.replace(timed.plan, robot=dataclasses.replace(NIRYO, lower=lower))
        words = r"^step 3 \(Descent to the object\) of niryo_one, a line of the tool: .*joint_2"
        with pytest.raises(StepUnsolvable, match=words):
            studies.timed_plan(narrow)


class TestClearance:
    def test_it_is_clear_as_the_plan_is(self, found):
        assert found.clearance.shape == (10,)
        assert found.clearance[2] == pytest.approx(0.0029, abs=1e-4)
        assert found.pairs[2] == ("tool", "table")
        assert np.min(found.clearance) > 0.0028
        assert found.tightest == 2

    def test_looking_closer_finds_no_more(self, timed, found):
        close = studies.timed_plan(timed.plan, step=1e-3)
        assert close.duration == pytest.approx(timed.duration, abs=1e-9)
        least = np.asarray(check_of(NIRYO).clearance(NIRYO, close.trajectory.q))
        for number, step in enumerate(close.steps):
            nearest = np.min(least[step.first : step.last + 1])
            assert nearest > 0.0028
            # What is looked at beside the trajectory is within 2 mm of it.
            assert nearest - 2e-3 < found.clearance[number] < nearest + 0.6e-3

    def test_a_raised_table_is_refused_with_the_time(self, timed):
        with pytest.raises(
            StepCollides,
            match=r"^step 3 \(Desc.*tool and table penetrate by 7\.\d mm, at 2\.62 s of",
        ) as told:
            studies.check_timed(timed, check_of(NIRYO, 0.01))
        error = told.value
        assert (error.step, error.pair) == (3, ("tool", "table"))
        assert error.time == pytest.approx(timed.steps[2].end, abs=1e-9)
        assert error.distance == pytest.approx(-0.0071, abs=1e-4)

    def test_a_post_in_a_free_way_is_refused(self, timed):
        post = co.World.capsules([[0.21, 0, 0.0]], [[0.21, 0, 0.25]], [0.01], names=["post"])
        check = co.CollisionCheck(co.shipped(NIRYO, "gripper_1"), post)
        with pytest.raises(StepCollides, match=r"step 6 .*post penetrate") as told:
            studies.check_timed(timed, check)
        assert timed.steps[5].begin < told.value.time < timed.steps[5].end

    def test_a_start_that_collides_is_refused(self, timed):
        place = poses(timed, timed.trajectory.q[0])[:3, 3]
        ball = co.World.capsules([place], [place + np.array([0, 0, 0.01])], [0.02], names=["ball"])
        check = co.CollisionCheck(co.shipped(NIRYO, "gripper_1"), ball)
        with pytest.raises(StepCollides, match=r"^step 1 \(Starting.* at 0\.00 s of") as told:
            studies.check_timed(timed, check)
        assert (told.value.step, told.value.time) == (1, 0.0)
        low = np.deg2rad([90.0, -60.0, -35.0, 0.0, 0.0, 0.0])
        with pytest.raises(StepCollides, match="step 1"):
            check_approach(timed.plan, check_of(NIRYO), low)

    def test_a_margin_is_kept_and_nothing_to_look_at_is_said(self, timed):
        with pytest.raises(StepCollides, match=r"come as near as 2\.9 mm \(margin 4\.0 mm\)"):
            studies.check_timed(timed, check_of(NIRYO, margin=0.004))
        model = co.shipped(NIRYO, "gripper_1")
        nothing = co.CollisionCheck(model.allow(model.pair_names()))
        assert np.all(np.isinf(studies.check_timed(timed, nothing).clearance))


def test_lines_of_the_tool_are_for_ways_on_which_the_joints_keep_to_them(timed):
    """At rest joint 5 is at 0: lines of the tool from there would turn joints 4 and 6 far out."""
    found = sections(timed)
    steps = [(x.first + 1, x.last + 1) for x in found]
    assert steps == [(2, 2), (3, 3), (5, 7), (9, 9), (10, 10)]
    assert [x.lines is None for x in found] == [True, False, False, False, True]
    for section in found:
        begin, whole = timed.steps[section.first].first, np.asarray(section.trajectory.q)
        np.testing.assert_allclose(whole[0], timed.trajectory.q[begin], atol=1e-12)
        assert section.trajectory.time[0] == 0
        if section.on_lines is not None:
            tool = poses(timed, section.on_lines)[:, None, :3, 3]
            near = np.linalg.norm(tool - poses(timed, whole)[:, :3, 3], axis=-1)
            assert np.max(np.min(near, axis=1)) < 3e-3


def connected(simulated, **options):
    arm = NiryoArm(simulated.address, robot=NIRYO, timeout=60.0, **{"settle": 0.0, **options})
    arm.connect()
    arm.calibrate()
    arm.use_tool("gripper_1")
    arm.release()
    return arm


def commands(simulated):
    return [request.command for request in simulated.received]


class TestExecuted:
    pytestmark = needs_pyniryo

    @pytest.mark.parametrize("version", ["4.1.1", "5.6.3"])
    def test_it_is_done_on_every_system(self, timed, version):
        noted, told = [], []
        with SimulatedNiryo(time_scale=1000.0, version=version) as simulated:
            simulated.place_object(OBJECT_START)
            with connected(simulated) as arm:
                arm.set_speed(41)
                records = studies.execute_timed(
                    timed,
                    arm,
                    noted.append,
                    keep_time=False,
                    progress=lambda *numbers: told.append(numbers),
                )
            np.testing.assert_allclose(simulated.object_position, OBJECT_END, atol=1e-6)
            assert not simulated.arm.holding
            np.testing.assert_allclose(simulated.arm.joints, timed.plan.steps[0].joints, atol=1e-4)
            assert (LINE_COMMAND in commands(simulated)) == (version == "4.1.1")
        assert records == tuple(noted)
        assert told
        assert [record.planned for record in records] == list(timed.plan.steps)
        ends = [record.end for record in records if record.end is not None]
        assert np.all(np.diff(ends) >= 0)
        for number, record in enumerate(records, start=1):
            assert record.timed is timed.steps[number - 1]
            # From the lift to the descent there is no halt, and nothing is read.
            assert (record.reached is None) == (record.late is None) == (number in (5, 6))
            if record.reached is not None:
                np.testing.assert_allclose(record.reached, record.planned.joints, atol=1e-4)
                assert (record.position_error is None) == (number in GRIPS)
                assert record.position_error is None or record.position_error < 0.5e-3

    def test_the_arm_keeps_the_time_of_the_plan(self, timed):
        """From the descent on: release, ascent."""
        part = dataclasses.replace(timed.plan, steps=timed.plan.steps[6:9])
        short = studies.timed_plan(part, dwell=0.3)
        with SimulatedNiryo(time_scale=1000.0) as simulated, connected(simulated) as arm:
            begin = time.monotonic()
            records = studies.execute_timed(short, arm)
            assert time.monotonic() - begin > 0.3
        assert records[1].end >= 0.3
        assert records[2].end > records[1].end

    def test_an_arm_with_gear_errors_is_told_other_joints(self, timed):
        gears = np.array([0.01, -0.01, 0.02, 0.0, 0.0, 0.005])
        worn = dataclasses.replace(timed, plan=dataclasses.replace(timed.plan, gears=gears))
        first, last = worn.motions[1]
        q = np.asarray(timed.part(first, last).q)
        np.testing.assert_allclose(worn.part(first, last).q, q / (1 + gears), atol=1e-15)

    def test_an_arm_that_stands_elsewhere_ends_it_there(self, timed):
        done = []
        with SimulatedNiryo(time_scale=1000.0) as simulated, connected(simulated) as arm:
            # The first is that to the start.
            simulated.inject(Fault(FaultKind.STILL, "MOVE_JOINTS", occurrence=4))
            with pytest.raises(ExecutionAborted, match=r"^step 2 \(Approach above") as told:
                studies.execute_timed(timed, arm, done.append, keep_time=False)
            assert told.value.state == ExecutionState.DEVIATED
            assert told.value.stops_done == 2
            assert "GRASP_WITH_TOOL" not in commands(simulated)
        assert len(done) == 1

    def test_a_refusal_on_the_way_of_several_steps_names_them(self, timed):
        done = []
        fault = Fault(FaultKind.REFUSE, LINE_COMMAND, occurrence=2, message="Collision")
        with SimulatedNiryo(time_scale=1000.0, faults=[fault]) as simulated:
            simulated.place_object(OBJECT_START)
            with connected(simulated) as arm:
                with pytest.raises(ExecutionAborted, match=r"^steps 5 to 7 \(Descent to") as told:
                    studies.execute_timed(timed, arm, done.append, keep_time=False)
                assert told.value.state == ExecutionState.REFUSED
                assert isinstance(told.value.__cause__, CommandRefused)
                np.testing.assert_allclose(arm.joints(), timed.plan.steps[3].joints, atol=1e-3)
            assert simulated.arm.holding
        assert len(done) == 4

    def test_stop_ends_it_at_a_stop(self, timed):
        with SimulatedNiryo(time_scale=1.0) as simulated, connected(simulated, settle=1.0) as arm:
            with pytest.raises(ExecutionAborted, match="stopped by the program") as told:
                studies.execute_timed(
                    timed, arm, progress=lambda *_: threading.Thread(target=arm.stop).start()
                )
            assert told.value.state == ExecutionState.STOPPED
            assert isinstance(told.value.__cause__, MotionStopped)
            np.testing.assert_allclose(arm.joints(), told.value.reached, atol=1e-3)

    def test_ctrl_c_closes_the_connection_and_sends_nothing_more(self, timed):
        def interrupt(record):
            if record.planned.step.action == "grasp":
                raise KeyboardInterrupt

        with SimulatedNiryo(time_scale=1000.0) as simulated:
            with pytest.raises(KeyboardInterrupt), connected(simulated) as arm:
                studies.execute_timed(timed, arm, interrupt, keep_time=False)
            assert commands(simulated)[-1] != "MOVE_JOINTS"
            assert commands(simulated).count("GRASP_WITH_TOOL") == 1


@pytest.fixture
def solved(monkeypatch, timed):
    """Commands take the plan that is solved and timed already."""
    pytest.importorskip("typer")
    pytest.importorskip("rich")
    module = "niryo_jax.cli.pick_and_place"
    monkeypatch.setattr(f"{module}.plan", lambda *_, **__: timed.plan)
    monkeypatch.setattr(f"{module}.time_plan", lambda *_: timed)


class TestCommand:
    @pytest.fixture(autouse=True)
    def _needs(self):
        pytest.importorskip("typer")
        pytest.importorskip("rich")

    def test_a_dry_run_shows_the_times(self, cli, as_json, timed):
        code, out, _ = cli("pick-and-place", "--timed", "--dry-run")
        assert code == 0
        assert f"takes {timed.duration:.2f} s; it does not halt at the ends of steps 2, 5, 6" in out
        assert "Least clearance: 2.9 mm, of tool and table, in step 3" in out
        code, document = as_json("pick-and-place", "--timed", "--dry-run", "--dwell", "0.5")
        assert code == document["steps_done"] == 0
        assert document["duration_s"] == pytest.approx(timed.duration - 1.0)
        steps = document["steps"]
        assert [step["way"] for step in steps] == [step.way for step in timed.steps]
        assert all(b["begin_s"] == a["end_s"] for a, b in itertools.pairwise(steps))
        assert steps[3]["end_s"] - steps[3]["begin_s"] == pytest.approx(0.5)
        trajectory = document["trajectory"]
        assert np.all(np.diff(trajectory["time_s"]) > 0)
        assert trajectory["time_s"][-1] == document["duration_s"]
        shape = (len(trajectory["time_s"]), 6)
        for name in ("joints_rad", "velocities_rad_s", "accelerations_rad_s2"):
            assert np.shape(trajectory[name]) == shape
        assert document["clearance"]["pair"] == ["tool", "table"]

    @pytest.mark.usefixtures("solved")
    def test_what_collides_is_refused_and_nothing_is_sent(self, as_json, cli):
        pytest.importorskip("pyniryo")
        with SimulatedNiryo(time_scale=1000.0) as simulated:
            command = ["pick-and-place", "--timed", "--host", simulated.address]
            code, document = as_json(*command, "--table", "0.01")
            assert code == document["exit_code"] == 8
            assert "penetrate by" in document["error"]
            collision = document["collision"]
            assert (collision["step"], collision["pair"]) == (3, ["tool", "table"])
            assert collision["time_s"] == document["steps"][2]["end_s"]
            # An arm that stands in the table may not set out from there.
            simulated.arm.move(np.deg2rad([90.0, -60.0, -35.0, 0.0, 0.0, 0.0]))
            code, _, err = cli(*command)
            assert code == 8
            assert "step 1 (Starting position)" in err
            sent = set(commands(simulated))
        assert not MOVING & sent

    @pytest.mark.parametrize(
        ("options", "said"),
        [
            (["--dwell", "1"], "--dwell goes with --timed"),
            (["--timed", "--dwell", "inf"], "--dwell: expected a finite number"),
            (["--timed", "--dwell", "-1"], "--dwell"),
            (["--timed", "--robot", "abb_irb120", "--dry-run"], "accelerations are known of"),
        ],
    )
    def test_mistakes_are_named(self, cli, options, said):
        code, _, err = cli("pick-and-place", *options)
        assert code == 2
        assert said in err


@pytest.mark.usefixtures("solved")
class TestCommandRuns:
    pytestmark = needs_pyniryo

    def test_the_simulated_robot_does_it(self, cli):
        code, out, err = cli("pick-and-place", "--timed", "--time-scale", "1000")
        assert code == 0
        assert "The object is at (148.0, 148.0, 0.0) mm." in out
        assert "no halt" in out
        assert "10/10  Return to the start" in err

    def test_a_fault_ends_with_4_and_the_steps_so_far(self, as_json):
        fault = Fault(FaultKind.REFUSE, "MOVE_JOINTS", occurrence=2, message="Collision")
        with SimulatedNiryo(time_scale=1000.0, faults=[fault]) as simulated:
            code, document = as_json("pick-and-place", "--timed", "--host", simulated.address)
        assert code == document["exit_code"] == 4
        assert document["steps_done"] == 1
        assert document["error"].startswith("step 2 (Approach above the object): ")
        assert document["error"].endswith("Collision")
        assert "joints_read_rad" not in document["steps"][1]

    def test_ctrl_c_says_what_was_done(self, as_json, monkeypatch):
        from niryo_jax.cli.progress import StepProgress

        advance = StepProgress.advance

        def interrupted(self, record):
            advance(self, record)
            if len(self.records) == 8:
                raise KeyboardInterrupt

        monkeypatch.setattr(StepProgress, "advance", interrupted)
        code, document = as_json("pick-and-place", "--timed", "--time-scale", "1000")
        assert code == document["exit_code"] == 130
        assert document["error"].startswith("interrupted after 8 of 10 steps")
        assert document["steps_done"] == 8
        np.testing.assert_allclose(document["object_position_m"], OBJECT_END, atol=1e-6)
        for number, step in enumerate(document["steps"][:8], start=1):
            assert (step["joints_read_rad"] is None) == (number in (5, 6))
            assert (step["reached_s"] is None) == (number in (5, 6))
        assert document["steps"][6]["reached_error_m"] < 0.5e-3


def test_the_figure_shows_all_three(timed, tmp_path):
    pytest.importorskip("matplotlib")
    figure = studies.timed_figure(timed, check_of(NIRYO))
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "joint angle (deg)",
        "height of the tool (mm)",
        "clearance (mm)",
    ]
    assert len(studies.timed_figure(timed).axes) == 2
    nj.figures.save(figure, tmp_path / "timed.png")
    assert (tmp_path / "timed.png").stat().st_size > 10_000
