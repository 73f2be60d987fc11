"""Collisions where they are used: complete sets, the command, maps, and plans."""

from __future__ import annotations

import ast
import dataclasses
import itertools
import json
import re
from pathlib import Path

import jax
import numpy as np
import pytest
from support import BATCHES

import niryo_jax as nj
from benchmarks.workspace import poses_at, slow_path
from niryo_jax import collision as co
from niryo_jax import workspace as ws
from niryo_jax.collision import FreeStatus
from niryo_jax.hardware import SimulatedNiryo
from niryo_jax.hardware.pick_and_place import plan, steps_for
from niryo_jax.hardware.plan_clearance import StepCollides, check_approach, check_plan

NIRYO = nj.robots.niryo_one()
MODEL = co.niryo_one("gripper_1")


@pytest.fixture(scope="module")
def sets():
    """Complete sets of random postures, of poses out of reach, and of none; and a table."""
    rng = np.random.default_rng(4)
    q = rng.uniform(NIRYO.lower, NIRYO.upper, (64, 6))
    poses = np.array(nj.forward_kinematics(NIRYO, q))
    poses[-1, :3, 3] = 3.0
    poses[-2] = np.nan
    return q, nj.inverse_kinematics(NIRYO, poses), co.World.table(-0.005)


class TestVerdict:
    def test_each_status_is_what_its_sentence_says(self, sets):
        _, solutions, world = sets
        found = co.free(NIRYO, MODEL, solutions, world)
        there, within = np.asarray(solutions.found), np.asarray(solutions.within_limits)
        least = np.asarray(co.clearance(NIRYO, MODEL, solutions.q, world))
        clear = there & (least > 0)
        np.testing.assert_array_equal(found.clear, clear)
        np.testing.assert_array_equal(found.within, clear & within)
        np.testing.assert_array_equal(found.clearance, np.where(there, least, -np.inf))
        seen = set()
        for i, code in enumerate(np.asarray(found.status)):
            status = FreeStatus(int(code))
            seen.add(status)
            facts = np.any(clear[i] & within[i]), np.any(within[i]), np.any(clear[i])
            assert {
                FreeStatus.FREE: facts[0],
                FreeStatus.COLLIDING_WITHIN_LIMITS: facts == (False, True, True),
                FreeStatus.COLLIDING: np.any(there[i]) and not facts[2],
                FreeStatus.OUTSIDE_LIMITS: facts == (False, False, True),
                FreeStatus.NOT_FOUND: not np.any(there[i]),
            }[status]
            assert status is FreeStatus.NOT_FOUND or found.message(i).startswith(status.message)
        assert {FreeStatus.FREE, FreeStatus.COLLIDING, FreeStatus.NOT_FOUND} <= seen
        assert "cannot be reached" in found.message(len(there) - 1)

    def test_a_collision_of_all_is_a_proof_where_the_set_is_complete_alone(self, sets):
        _, solutions, _ = sets
        wall = co.World.spheres([[0.0, 0.0, 0.2]], [2.0])
        found = co.free(NIRYO, MODEL, solutions, wall)
        some = np.any(np.asarray(solutions.found), axis=-1)
        np.testing.assert_array_equal(found.all_collide, some & np.asarray(solutions.complete))
        assert "it is proved, for the shapes given" in found.message(0)
        unproved = dataclasses.replace(solutions, complete=np.zeros_like(some))
        found = co.free(NIRYO, MODEL, unproved, wall)
        assert not np.any(found.all_collide)
        np.testing.assert_array_equal(found.status[some], FreeStatus.COLLIDING)
        assert "There may be more solutions" in found.message(0)

    def test_one_of_infinitely_many_proves_nothing_of_the_others(self, sets):
        _, solutions, _ = sets
        code = np.where(solutions.found, nj.Singularity.WRIST, nj.Singularity.NONE)
        endless = dataclasses.replace(solutions, singularity=code)
        found = co.free(NIRYO, MODEL, endless, co.World.spheres([[0.0, 0.0, 0.2]], [2.0]))
        assert not np.any(found.all_collide)
        assert "infinitely many" in found.message(0)
        idle = dataclasses.replace(solutions, free=(5,))
        assert not np.any(co.free(NIRYO, MODEL, idle).proved)

    def test_whole_turns_change_nothing(self, sets):
        _, solutions, world = sets
        turns = np.random.default_rng(1).integers(-2, 3, solutions.q.shape)
        turned = dataclasses.replace(solutions, q=solutions.q + 2 * np.pi * turns)
        given, other = (co.free(NIRYO, MODEL, x, world) for x in (solutions, turned))
        np.testing.assert_allclose(other.clearance, given.clearance, rtol=0, atol=1e-13)
        np.testing.assert_array_equal(other.status, given.status)

    def test_the_nearest_is_that_of_those_that_are_free(self, sets):
        q, solutions, world = sets
        found = co.free(NIRYO, MODEL, solutions, world, margin=0.002)
        usable = np.asarray(found.within)
        chosen, ok = found.nearest(q)
        np.testing.assert_array_equal(ok, np.any(usable, axis=-1))
        every = np.asarray(solutions.q)
        for i in np.flatnonzero(ok):
            away = np.max(np.abs(every[i][usable[i]] - q[i]), axis=-1)
            assert np.max(np.abs(chosen[i] - q[i])) <= np.min(away) + 1e-12
            assert co.clearance(NIRYO, MODEL, chosen[i], world) > 0.002

    def test_the_clearest_has_the_greatest_clearance(self, sets):
        _, solutions, world = sets
        found = co.free(NIRYO, MODEL, solutions, world)
        usable = np.asarray(found.within)
        chosen, ok = found.clearest()
        np.testing.assert_array_equal(ok, np.any(usable, axis=-1))
        best = np.max(np.where(usable, found.clearance, -np.inf), axis=-1)
        least = np.asarray(co.clearance(NIRYO, MODEL, chosen, world))
        np.testing.assert_allclose(least[ok], best[ok], rtol=0, atol=1e-13)

    @pytest.mark.parametrize("batch", BATCHES)
    @pytest.mark.parametrize("dtype", [np.float32, np.float64])
    def test_batches_and_precision(self, sets, batch, dtype):
        _, solutions, world = sets
        size = int(np.prod(batch))

        def cut(x):
            kept = np.asarray(x)[:size].reshape((*batch, *x.shape[1:]))
            return kept.astype(dtype) if kept.dtype == np.float64 else kept

        some = solutions.map(cut)
        found = co.free(NIRYO, MODEL, some, world)
        assert found.status.shape == found.proved.shape == batch
        assert found.clear.shape == found.clearance.shape == some.found.shape
        assert found.clearance.dtype == dtype
        assert found.clearest()[0].shape == found.nearest(np.zeros(6))[0].shape == (*batch, 6)
        mapped = jax.jit(lambda x: co.free(NIRYO, MODEL, x, world).status)(some)
        np.testing.assert_array_equal(mapped, found.status)

    def test_what_is_none_is_named(self, sets):
        _, solutions, _ = sets
        with pytest.raises(TypeError, match="solutions: expected IKSolutions"):
            co.free(NIRYO, MODEL, solutions.q)
        with pytest.raises(ValueError, match="margin: expected a finite number"):
            co.free(NIRYO, MODEL, solutions, margin=np.inf)
        with pytest.raises(ValueError, match=r"solutions: expected shape \(\.\.\., 7\)"):
            co.free(nj.robots.load("kuka_iiwa14"), MODEL, solutions)


COUNT, BOX = 24, ((-0.12, -0.12, -0.08), (0.12, 0.12, 0.6))
CHECK = co.CollisionCheck(co.niryo_one(), co.World.table(0.0), margin=0.001)


@pytest.fixture(scope="module")
def maps():
    """A plain map, and one without collisions, around the base of the Niryo One."""
    pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    made = (
        ws.capability_map(NIRYO, 0.04, BOX, COUNT, full=True, collisions=collisions)
        for collisions in (None, CHECK)
    )
    return tuple(made)


class TestMaps:
    def test_every_number_is_that_of_the_slow_path(self, maps):
        _, found = maps
        axes = np.meshgrid(*(found[axis] for axis in "xyz"), indexing="ij")
        poses = poses_at(found, np.stack(axes, axis=-1))
        truths = slow_path(NIRYO, poses, found.attrs["dexterous"], CHECK)
        for name, truth in truths.items():
            np.testing.assert_allclose(found[name], truth, rtol=3e-7, atol=1e-9, err_msg=name)
        assert "colliding_fraction" in truths
        count = truths["pose_solutions"]
        np.testing.assert_array_equal(
            found.solution_histogram.sum("chunk"), np.bincount(count.ravel(), minlength=17)
        )

    def test_what_collides_is_what_a_plain_map_has_more(self, maps):
        plain, found = maps
        both = found.reachability_index + found.colliding_fraction
        np.testing.assert_allclose(both, plain.reachability_index, rtol=0, atol=1e-7)
        assert "colliding_fraction" not in plain
        assert float(found.colliding_fraction.max()) > 0.3
        for name in ("reachability_index_unlimited", "undecided_fraction"):
            np.testing.assert_array_equal(found[name], plain[name])

    def test_nothing_is_reached_inside_the_base(self, maps):
        """Where the tool point is within the base or the shoulder, or below the table."""
        plain, found = maps
        x, y, z = np.meshgrid(*(found[axis] for axis in "xyz"), indexing="ij")
        inside = np.zeros(x.shape, bool)
        for name in ("base", "shoulder"):
            i = CHECK.model.names.index(name)
            (_, _, low), (_, _, high) = CHECK.model.start[i], CHECK.model.end[i]
            away = np.sqrt(x**2 + y**2 + (z - np.clip(z, low, high)) ** 2)
            inside |= away < CHECK.model.radius[i]
        assert np.all(found.reachability_index.values[inside | (z < 0)] == 0)
        # The plain map says that half of all orientations are reached there.
        assert plain.reachability_index.values[inside].max() > 0.4
        assert found.reachability_index.values.max() > 0.1

    def test_the_store_knows_and_goes_on(self, maps, tmp_path):
        _, found = maps
        store = tmp_path / "map.zarr"
        asked = {"voxel": 0.04, "bounds": BOX, "orientations": COUNT, "full": True}
        half = ws.capability_map(NIRYO, store=store, collisions=CHECK, share=(0, 2), **asked)
        assert half.attrs["chunks_missing"] == 1
        whole = ws.resume(store)
        assert whole.equals(found)
        assert whole.attrs == found.attrs
        assert "free of collisions" in whole.attrs["title"]
        other = co.CollisionCheck(CHECK.model, CHECK.world, margin=0.002)
        for collisions in (None, other):
            with pytest.raises(ws.StoreError, match="it was made with"):
                ws.capability_map(NIRYO, store=store, collisions=collisions, **asked)
        again = co.CollisionCheck.from_text(whole.attrs["collisions"])
        assert again.text() == CHECK.text()

    def test_placements_stay_clear(self, maps):
        """A pose within the base, which the arm can take by passing through itself."""
        plain, found = maps
        at = np.argwhere((plain.pose_solutions.values > 0) & (found.pose_solutions.values == 0))[0]
        task = poses_at(plain, np.array([plain[axis][i] for axis, i in zip("xyz", at[:3])]))[at[3]]
        asked = {"region": ((0, 0), (0, 0)), "headings": 1}
        assert ws.base_placement(plain, task[None], **asked).share == [1.0]
        assert len(ws.base_placement(found, task[None], **asked).base) == 0
        assert ws.collisions_of(plain) is None
        assert ws.collisions_of(found).margin == CHECK.margin

    @pytest.mark.parametrize("collisions", [CHECK.model, "niryo_one"])
    def test_what_is_no_check_is_named(self, collisions):
        with pytest.raises(TypeError, match="collisions: expected a CollisionCheck or None"):
            ws.MapSpec.of(NIRYO, 0.1, BOX, 4, collisions=collisions)
        scara = nj.robots.load("abb_irb910sc")
        with pytest.raises(ValueError, match="links of an arm of 4 joints"):
            ws.pose_measures(scara, np.eye(4), collisions=CHECK)


PICK = ["0.148", "-0.148", "0.088", "--rpy", "0", "90", "0", "--degrees"]
GRIPPER = ["--collision", "--collision-tool", "gripper_1"]


class TestCommandIk:
    @pytest.fixture(autouse=True)
    def _needs(self):
        pytest.importorskip("typer")
        pytest.importorskip("rich")

    def test_each_solution_has_its_clearance(self, as_json):
        code, document = as_json("ik", *PICK, *GRIPPER, "--table", "0")
        assert code == 0
        assert document["collisions"]["status"] == "FREE"
        assert document["collisions"]["proved"]
        for solution in document["solutions"]:
            least = co.distances(NIRYO, MODEL, solution["joints_rad"], co.World.table(0.0))
            assert solution["clearance_m"] == pytest.approx(float(least.distance.min()), abs=1e-12)
            assert tuple(solution["nearest_pair"]) == least.nearest_pair()
            assert solution["collides"] == (solution["clearance_m"] <= 0)

    def test_people_see_it_too(self, cli):
        code, out, _ = cli("ik", *PICK, *GRIPPER, "--table", "0")
        assert code == 0
        assert "clearance (mm)" in out
        assert re.search(r"1 +-45\.00 .* 2\.9 +tool, table", out)
        assert "Free of collisions within the limits: 1; most clearance: 1, 2.9 mm." in out

    def test_a_pose_at_which_all_collide_has_its_own_exit_code(self, cli, as_json):
        arguments = ["ik", *PICK, *GRIPPER, "--table", "0.05"]
        code, document = as_json(*arguments)
        assert code == document["exit_code"] == 8
        assert document["status"] == "SOLVED"
        assert document["collisions"]["status"] == "COLLIDING"
        assert "it is proved, for the shapes given" in document["error"]
        code, out, err = cli(*arguments)
        assert code == 8
        assert "error: Solutions were found, and every one of them collides." in err
        assert "tool, table" in out
        assert as_json(*arguments[:-1], "0", "--margin", "0.01")[0] == 8

    def test_without_it_nothing_is_said(self, as_json):
        code, document = as_json("ik", *PICK)
        assert code == 0
        assert "collisions" not in document
        assert "clearance_m" not in document["solutions"][0]

    @pytest.mark.parametrize(
        ("options", "said"),
        [
            (["--table", "0"], "--table goes with --collision"),
            (["--margin", "0.1"], "--margin goes with --collision"),
            (["--collision", "--margin", "nan"], "--margin: expected a finite number"),
            (["--collision", "--table", "inf"], "--table: expected a finite number"),
            (["--collision", "--collision-tool", "drill"], "--collision-tool: expected one of"),
            (["--collision", "--robot", "ur16e"], "give one: --collision-model FILE.urdf"),
            (["--collision", "--collision-model", "no.urdf"], "--collision-model: no.urdf"),
        ],
    )
    def test_mistakes_are_named(self, cli, options, said):
        code, _, err = cli("ik", *PICK, *options)
        assert code == 2
        assert said in err

    def test_a_description_is_a_shape(self, as_json, tmp_path):
        pytest.importorskip("yourdfpy")
        file = tmp_path / "two.urdf"
        file.write_text(TWO_LINKS)
        arguments = ["ik", "0", "0.5", "0.5", "--radians", "--task", "position"]
        arguments += ["--robot", file, "--collision", "--collision-model", file]
        code, document = as_json(*arguments)
        assert (code, document["collisions"]["status"]) == (0, "FREE")
        code, document = as_json(*arguments, "--table", "0.6")
        assert (code, document["collisions"]["status"]) == (8, "COLLIDING")
        code, document = as_json("ik", *PICK, "--collision", "--collision-model", file)
        assert code == 2
        assert "its joints are not those of niryo_one" in document["error"]


TWO_LINKS = """<robot name="two">
  <link name="base"/>
  <joint name="a" type="revolute"><parent link="base"/><child link="first"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <link name="first"/>
  <joint name="b" type="revolute"><parent link="first"/><child link="arm"/>
    <origin xyz="0 0 0.5"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <link name="arm"><collision><origin xyz="0.25 0 0" rpy="0 1.5707963 0"/>
    <geometry><cylinder radius="0.02" length="0.5"/></geometry></collision></link>
  <joint name="c" type="fixed"><parent link="arm"/><child link="tip"/>
    <origin xyz="0.5 0 0"/></joint>
  <link name="tip"/>
</robot>"""


class TestCommandMap:
    """`workspace map`, `resume` and `info` of a map that looks at collisions."""

    @pytest.fixture
    def made(self, maps, tmp_path):
        """The map of `CHECK` as the command asks for it: the store, and what was said."""
        pytest.importorskip("typer")
        pytest.importorskip("rich")
        del maps
        store = tmp_path / "one.zarr"
        corners = [x for corner in BOX for x in corner]
        arguments = ["workspace", "map", "niryo_one", "--voxel", 0.04, "--orientations", COUNT]
        arguments += ["--bounds", *corners, "--full", "-o", store]
        arguments += ["--collision", "--table", 0, "--margin", 0.001]
        return store, arguments

    def test_it_is_that_of_the_library(self, made, maps, cli, as_json):
        store, arguments = made
        _, found = maps
        code, out, err = cli(*arguments, "--json")
        assert code == 0
        size = found.reachability_index.size
        assert f"niryo_one, free of collisions: {size} voxels" in err
        document = json.loads(out)
        assert document["collisions"] == "none with itself, table, 1 mm apart"
        colliding = float(found.colliding_fraction.sum()) * COUNT
        assert document["poses_colliding"] == round(colliding) > 0
        opened = ws.open_map(store)
        assert opened.equals(found)
        assert opened.attrs == found.attrs
        for again in (["workspace", "resume", store], ["workspace", "info", store]):
            assert as_json(*again) == (0, document)
        code, _, err = cli(*arguments[:-2])
        assert code == 6
        assert "it was made with collisions = " in err

    def test_an_arm_without_a_shape_is_told_how_to_give_one(self, cli):
        code, _, err = cli("workspace", "map", "ur16e", "--collision", "--dry-run")
        assert code == 2
        assert "give one: --collision-model FILE.urdf" in err


TABLE = co.CollisionCheck(MODEL, co.World.table(0.0))


@pytest.fixture(scope="module")
def planned():
    return plan(NIRYO)


class TestPlan:
    """Table 2.1, looked at before it is sent."""

    def test_the_published_poses_are_clear_of_the_table(self, planned):
        """The jaws of gripper 1 end 3 mm above the table, half a millimetre less for its tilt."""
        found = check_plan(planned, TABLE)
        assert found.tightest == 2
        assert found.pairs[2] == ("tool", "table")
        assert found.clearance[2] == pytest.approx(0.088 - 0.085, abs=2e-4)
        assert np.all(found.clearance > 0.0025)

    def test_it_is_what_looking_closer_finds(self, planned):
        found = check_plan(planned, TABLE, np.zeros(6))
        stops = [np.zeros(6), *(step.joints for step in planned.steps)]
        for step, (start, end) in enumerate(itertools.pairwise(stops)):
            way = start + np.linspace(0, 1, 5_001)[:, None] * (end - start)
            least = np.asarray(TABLE.clearance(NIRYO, way))
            assert found.clearance[step] == pytest.approx(np.min(least), abs=0.6e-3)

    def test_a_way_that_collides_is_refused_though_its_ends_are_free(self, planned):
        # In the middle of the way of step 6, from the object to its destination.
        post = co.World.capsules([[0.21, 0, 0.0]], [[0.21, 0, 0.25]], [0.01], names=["post"])
        check = co.CollisionCheck(MODEL, post)
        ends = np.stack([step.joints for step in planned.steps])
        assert np.all(check.keeps(NIRYO, ends)[1:9])
        later = dataclasses.replace(planned, steps=planned.steps[1:9])
        with pytest.raises(
            StepCollides, match=r"step 5 \(Approach above the destination\)"
        ) as told:
            check_plan(later, check)
        error = told.value
        assert (error.step, error.pair[1]) == (5, "post")
        assert error.distance < 0
        assert f"{error.pair[0]} and post penetrate by {-1e3 * error.distance:.1f} mm" in str(error)

    def test_a_margin_is_kept(self, planned):
        with pytest.raises(StepCollides, match=r"come as near as 2\.9 mm \(margin 5\.0 mm\)"):
            check_plan(planned, dataclasses.replace(TABLE, margin=0.005))
        check_plan(planned, dataclasses.replace(TABLE, margin=0.002))

    def test_the_way_from_where_the_arm_stands(self, planned):
        check_approach(planned, TABLE, np.zeros(6))
        low = np.deg2rad([90.0, -60.0, -35.0, 0.0, 0.0, 0.0])
        with pytest.raises(StepCollides, match=r"step 1 \(Starting position\)"):
            check_approach(planned, TABLE, low)

    @pytest.mark.parametrize("name", ["niryo_ned", "niryo_ned2"])
    def test_the_other_arms_are_clear_too(self, name):
        robot = nj.robots.load(name)
        check = co.CollisionCheck(co.shipped(robot, "gripper_1"), co.World.table(0.0))
        assert np.min(check_plan(plan(robot, steps_for(robot)), check).clearance) > 0.0025

    def test_nothing_to_look_at(self, planned):
        nothing = co.CollisionCheck(MODEL.allow(MODEL.pair_names()))
        assert np.all(np.isinf(check_plan(planned, nothing).clearance))


class TestCommandPlan:
    @pytest.fixture(autouse=True)
    def _needs(self):
        pytest.importorskip("typer")
        pytest.importorskip("rich")

    def test_a_dry_run_says_how_clear_it_is(self, cli, as_json):
        code, out, _ = cli("pick-and-place", "--dry-run")
        assert code == 0
        assert "Least clearance: 2.9 mm, of tool and table, in step 3 (Descent to" in out
        code, document = as_json("pick-and-place", "--dry-run")
        assert code == 0
        assert document["clearance"]["pair"] == ["tool", "table"]
        assert document["clearance"]["step"] == 3
        assert len(document["clearance"]["steps_m"]) == 10

    def test_a_plan_that_collides_is_refused(self, as_json):
        # The longer gripper reaches through the table.
        arguments = ["pick-and-place", "--dry-run", "--tool", "gripper_2"]
        code, document = as_json(*arguments)
        assert code == document["exit_code"] == 8
        assert document["collision"]["pair"] == ["tool", "table"]
        assert document["collision"]["distance_m"] == pytest.approx(-0.029, abs=1e-3)
        assert re.search(r"step 3 \(Descent.*penetrate by 29\.\d mm", document["error"])
        assert as_json(*arguments, "--table", "-0.03")[0] == 0
        code, document = as_json(*arguments, "--no-collision-check")
        assert (code, document["clearance"]) == (0, None)

    def test_nothing_is_sent_of_it(self, cli):
        pytest.importorskip("pyniryo")
        with SimulatedNiryo(time_scale=1000.0) as simulated:
            host = ["--host", simulated.address]
            code, _, err = cli("pick-and-place", *host, "--table", "0.01")
            assert code == 8
            assert "penetrate by" in err
            # An arm that stands in the table may not set out from there.
            simulated.arm.move(np.deg2rad([90.0, -60.0, -35.0, 0.0, 0.0, 0.0]))
            code, _, err = cli("pick-and-place", *host)
            assert code == 8
            assert "step 1 (Starting position)" in err
            sent = {request.command for request in simulated.received}
        assert not {"MOVE_JOINTS", "OPEN_GRIPPER", "CLOSE_GRIPPER"} & sent

    def test_an_arm_without_a_shape_is_not_looked_at_and_that_is_said(self, cli):
        code, out, err = cli("pick-and-place", "--dry-run", "--robot", "niryo_one_report")
        assert code == 0
        assert "collisions are not looked at" in err
        assert "Least clearance" not in out
        code, _, err = cli("pick-and-place", "--dry-run", "--no-collision-check", "--table", "0")
        assert code == 2
        assert "--no-collision-check goes without" in err


def imports(package: str) -> dict[str, set[str]]:
    """Of each module of a package, the packages of niryo_jax that it imports."""
    out = {}
    for path in sorted((Path(nj.__file__).parent / package).rglob("*.py")):
        nodes = [x for x in ast.walk(ast.parse(path.read_text())) if isinstance(x, ast.ImportFrom)]
        parts = [
            [*(node.module or "").split("."), *(name.name for name in node.names)] for node in nodes
        ]
        out[path.stem] = {part[1] for part in parts if part[0] == "niryo_jax"}
    return out


def test_collision_is_used_by_those_that_may_and_uses_none_of_them():
    uses = {"hardware", "workspace", "motion", "uncertainty", "calibration"}
    assert not any(found & uses for found in imports("collision").values())
    driving = {name for name, found in imports("hardware").items() if "collision" in found}
    assert driving == {"plan_clearance"}
    for package in ("uncertainty", "calibration"):
        assert not any("collision" in found for found in imports(package).values())


def test_an_arm_is_driven_without_what_times_a_path():
    assert not any(found & {"motion", "studies"} for found in imports("hardware").values())
