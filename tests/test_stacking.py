"""Blocks that a worn arm stacks, the plan that moves them, and what calibration gains."""

from __future__ import annotations

import json

import numpy as np
import pytest

import niryo_jax as nj
from niryo_jax.hardware import SimulatedNiryo, stacking
from niryo_jax.hardware.measuring import touch
from niryo_jax.hardware.pick_and_place import plan
from niryo_jax.hardware.simulated.things import Things
from niryo_jax.hardware.simulated.wear import Wear, WornJoints
from niryo_jax.robots import MODELS, NIRYO_ONE

LAYOUT = stacking.Layout()


def standing(x=0.0, y=0.0, z=0.0, turn=0.0):
    pose = np.eye(4)
    pose[:2, :2] = (np.cos(turn), -np.sin(turn)), (np.sin(turn), np.cos(turn))
    pose[:3, 3] = x, y, z
    return pose


@pytest.fixture(scope="module")
def planned():
    return plan(NIRYO_ONE.robot(), stacking.steps_for(LAYOUT, NIRYO_ONE))


def test_the_plan_moves_few_joints_at_a_time_and_joint_6_only_at_a_cell(planned):
    before = planned.steps[0].joints
    for step in planned.steps[1:]:
        moved = np.flatnonzero(np.abs(step.joints - before) > 1e-6)
        before = step.joints
        if step.step.title in ("Above the cell", "Above the layout"):
            continue
        assert len(moved) <= 3 or step.step.title == "Rest"
        assert 5 not in moved
        if step.step.title in ("Turn to the stack", "Stop on the way"):
            assert moved.tolist() == [0]
    by_hand = [step.step.action for step in planned.steps if step.step.action != "move"]
    assert by_hand == ["grasp", "release"] * 4


def test_the_tool_keeps_to_the_vertical_at_a_block(planned):
    robot = NIRYO_ONE.robot()
    legs = []
    for first, second in zip(planned.steps, planned.steps[1:]):
        vertical = second.step.title.startswith(("Descend", "Lift", "Ascend"))
        if vertical:
            shares = np.linspace(0, 1, 9)[:, None]
            legs.append(first.joints + shares * (second.joints - first.joints))
    place = np.asarray(nj.forward_kinematics(robot, np.array(legs)))[..., :2, 3]
    assert np.linalg.norm(place - place[:, :1], axis=-1).max() < 3e-4
    assert all(x.step.percent == 5 for x in planned.steps if x.step.title.startswith("Descend"))


@pytest.mark.parametrize("name", MODELS)
def test_every_niryo_reaches_the_layout(name):
    model = MODELS[name]
    planned = plan(model.robot(), stacking.steps_for(LAYOUT, model))
    assert max(step.position_error or 0.0 for step in planned.steps) < 1e-9


def test_a_block_falls_upright_on_what_is_below_it():
    things = Things()
    things.put([standing(), standing(0.1)], (0.03, 0.03, 0.033))
    tool = standing(0.0, 0.0, 0.2)
    things.grasp(standing(0.0, 0.0, 0.016), np.zeros(3))
    assert things.holding
    np.testing.assert_allclose(things.poses(tool)[0], standing(0.0, 0.0, 0.184), atol=1e-12)
    things.release(standing(0.125, 0.0, 0.2, turn=0.1))
    np.testing.assert_allclose(things.poses(tool)[0], standing(0.125, 0, 0.033, 0.1), atol=1e-12)
    # Beside it, turned by an eighth, the corners of one would be inside the other's square.
    things.grasp(standing(0.125, 0.0, 0.033 + 0.016, turn=0.1), np.zeros(3))
    things.release(standing(0.137, 0.0, 0.2, turn=0.1 + np.pi / 4))
    assert things.poses(tool)[0, 2, 3] == 0.0
    things.release(tool)
    assert not things.holding


def test_a_block_is_in_its_cell_if_all_corners_are():
    def lying(x=0.0, turn=0.0, z=0.0):
        return [cell @ standing(x, 0.0, z, turn) for cell in LAYOUT.cells]

    def inside(**how):
        return [block.inside for block in stacking.judged(LAYOUT, lying(**how))]

    for how in ({}, {"x": 0.9e-3}, {"turn": 0.06}):
        assert all(inside(**how))
    assert not any(inside(x=1.1e-3))
    assert not any(inside(turn=0.08))
    assert not any(inside(x=0.9e-3, turn=0.02))
    assert not any(inside(z=0.033)), "on another one"


def test_worn_joints_lag_behind_on_the_side_they_came_from():
    wear = Wear(offsets=0.01, gears=[0.1, 0, 0, 0, 0, 0], play=0.002)
    worn = WornJoints(wear)
    one, two = np.full(6, 0.5), np.array([0.7, 0.3, 0.5, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(worn.at(one), [0.56, *[0.51] * 5])
    worn.move(np.stack([np.zeros(6), one, two]))
    np.testing.assert_allclose(worn.at(two), [0.779, 0.311, *[0.509] * 4])
    # Rounding is no move: it neither turns the play round nor draws another rest.
    worn.move(np.stack([two, two - 1e-12]))
    np.testing.assert_allclose(worn.at(two), [0.779, 0.311, *[0.509] * 4])
    drawn = WornJoints(Wear(noise=1e-3, seed=4))
    places = []
    for _ in range(400):
        drawn.move(np.stack([one, two]))
        places.append(drawn.at(two) - two)
    spread = np.std(places, axis=0)
    np.testing.assert_allclose(spread[:2], 1e-3, rtol=0.15)
    np.testing.assert_array_equal(spread[2:], 0.0)


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ({"play": -1.0}, "play: expected finite numbers, none below zero, got -1.0"),
        ({"offsets": [1, 2]}, "offsets: expected one number or six"),
        ({"gears": np.nan}, "gears: expected finite numbers, got nan"),
        ({"noise": "much"}, "noise: expected one number or six, got 'much'"),
    ],
)
def test_impossible_wear_is_refused(bad, words):
    with pytest.raises(ValueError, match=words):
        Wear(**bad)


def test_the_arm_reads_what_its_encoders_say_and_stands_elsewhere():
    with SimulatedNiryo(time_scale=1e4, wear=Wear(offsets=0.01)) as simulated:
        arm = simulated.arm
        q = np.array([0.1, 0.2, -0.3, 0.4, 0.1, 0.2])
        arm.move(q)
        while np.any(arm.joints != q):
            pass
        np.testing.assert_allclose(arm.pose, arm.pose_at(q), atol=1e-12)
        np.testing.assert_allclose(simulated.true_pose, arm.pose_at(q + 0.01), atol=1e-12)


def test_places_touched_by_hand_are_read_in_learning_mode():
    class Held:
        learning_mode = False
        turned = 0.0

        def joints(self):
            return np.full(6, self.turned)

        def move_joints(self, q):
            raise AssertionError

    arm, places = Held(), np.arange(9.0).reshape(3, 3)

    def ready(number, place):
        np.testing.assert_array_equal(place, places[number])
        assert arm.learning_mode
        arm.turned = 0.1 * number

    q, seen = touch(arm, places, ready)
    np.testing.assert_allclose(q, np.repeat([[0.0], [0.1], [0.2]], 6, axis=1))
    np.testing.assert_array_equal(seen, places)
    with pytest.raises(ValueError, match=r"places: expected finite \(N, 3\), got shape \(3,\)"):
        touch(arm, places[0], ready)


@pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning")
@pytest.mark.parametrize("seeds", [3, pytest.param(20, marks=pytest.mark.completeness)])
def test_calibration_brings_every_block_into_its_cell(seeds):
    pytest.importorskip("pyniryo")
    from niryo_jax.studies import block_stacking

    studies = [block_stacking(seed) for seed in range(seeds)]
    before, after = (
        np.array([[block.inside for block in getattr(study, when)] for study in studies])
        for when in ("before", "after")
    )
    assert np.all(before, axis=1).sum() <= 3 * seeds / 20
    assert np.all(after)
    for study in studies:
        wear, found = study.wear, study.calibration
        np.testing.assert_allclose(found.gears, wear.gears, atol=2e-3)
        # Half of the play has a direction: it looks like an offset where a joint is always
        # approached from one side.
        np.testing.assert_allclose(found.offsets, wear.offsets, atol=1.5e-3)


@pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning")
def test_the_command_drives_a_robot_with_what_was_measured_of_it(cli, tmp_path, monkeypatch):
    pytest.importorskip("pyniryo")
    from niryo_jax.cli import stack
    from niryo_jax.studies import postures

    monkeypatch.setattr(stack, "PAUSE", 0.0)
    robot, wear = NIRYO_ONE.robot(), Wear(offsets=0.01)
    q = postures(robot, 12)
    # Places alone do not tell the zero of the last joint, which then is held.
    places = np.asarray(nj.forward_kinematics(robot, q + 0.01))[:, :3, 3] * 1e3
    head = ",".join([*(f"q{i}_rad" for i in range(1, 7)), "x_mm", "y_mm", "z_mm"])
    body = "\n".join(",".join(map(repr, row)) for row in np.hstack([q, places]).tolist())
    (tmp_path / "data.csv").write_text(f"{head}\n{body}\n")
    with SimulatedNiryo(time_scale=1e4, wear=wear) as simulated:
        simulated.place_blocks(LAYOUT.stacked, LAYOUT.size)
        code, out, err = cli(
            "stack", "--host", simulated.address, "--calibration", tmp_path / "data.csv", "--json"
        )
        assert code == 0, err
        document = json.loads(out)
        assert document["steps_done"] == len(document["steps"])
        assert err.count("Release the block") == 4
        blocks = stacking.judged(LAYOUT, simulated.blocks)
    assert all(block.inside for block in blocks)


@pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning")
def test_the_command_shows_what_calibration_gains(cli):
    pytest.importorskip("pyniryo")
    code, out, _ = cli("stack", "--json")
    document = json.loads(out)
    assert code == 0
    assert sum(block["inside"] for block in document["after"]) == 4
    assert sum(block["inside"] for block in document["before"]) < 4
    code, out, _ = cli("stack", "--dry-run", "--target-at", 150, 180)
    assert code == 0
    assert "Turn to the stack" in out
    code, _, err = cli("stack", "--target-at", 400, 400)
    assert code != 0
    assert "Above the layout" in err or "Stop on the way" in err
    code, _, err = cli("stack", "--robot", "panda")
    assert code == 2
    assert "niryo_one" in err
    code, _, err = cli("stack", "--calibration", "none.csv")
    assert code == 2
    assert "--host" in err
