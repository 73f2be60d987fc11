"""The viewer without a browser: what is shown is what the package's own functions say."""

from __future__ import annotations

import dataclasses
import importlib.util
import inspect
import json
import signal
import socket
import subprocess
import sys
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from support import product_of_exponentials, random_rotations

import niryo_jax as nj
from niryo_jax import collision, uncertainty
from niryo_jax.robots import catalogue
from niryo_jax.viewer import Session, colours, route, shape_of
from niryo_jax.viewer.geometry import capsule, ellipsoid, merged, places, pose_of, shrunk
from niryo_jax.viewer.panel import ends_of
from niryo_jax.viewer.scene import colours_of
from niryo_jax.viewer.task import Task
from niryo_jax.viewer.voxels import Voxels
from niryo_jax.viewer.worker import Worker

needs_viser = pytest.mark.skipif(
    importlib.util.find_spec("viser") is None, reason="the extra viewer is not installed"
)
FAR = np.array([[1.0, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


@pytest.fixture(scope="module")
def session():
    return Session(nj.robots.niryo_one(), covariance=np.diag(np.arange(1.0, 7.0) * 1e-6))


# --- triangles and poses


def volume(mesh):
    """By the divergence theorem: positive where faces are counter-clockwise from outside."""
    a, b, c = np.moveaxis(mesh.vertices.astype(float)[mesh.faces], 1, 0)
    return float(np.sum(a * np.cross(b, c)) / 6)


@pytest.mark.parametrize("length", [0.0, 0.3])
def test_a_capsule_is_all_that_is_within_a_radius_of_its_segment(length, rng):
    start = rng.normal(size=3)
    end = start + length * random_rotations(rng)[0].astype(float)
    mesh = capsule(start, end, 0.05)
    along = (mesh.vertices - start) @ (end - start) / max(length**2, 1e-30)
    nearest = start + np.clip(along, 0, 1)[:, None] * (end - start)
    distance = np.linalg.norm(mesh.vertices - nearest, axis=1)
    np.testing.assert_allclose(distance, 0.05, atol=1e-6)
    true = np.pi * 0.05**2 * length + 4 / 3 * np.pi * 0.05**3
    assert 0.94 * true < volume(mesh) < true
    inner = shrunk(mesh, 0.01)
    assert volume(capsule(start, end, 0.035)) < volume(inner) < volume(mesh)


def test_meshes_are_merged_side_by_side():
    parts = [capsule(np.zeros(3), np.array([x, 0, 0]), 0.1) for x in (0.0, 0.2, 0.5)]
    assert volume(merged(parts)) == pytest.approx(sum(map(volume, parts)), rel=1e-5)


def test_poses_there_and_back(rng):
    rotation = random_rotations(rng, (4, 3)).astype(float)
    poses = np.tile(np.eye(4), (4, 3, 1, 1))
    poses[..., :3, :3], poses[..., :3, 3] = rotation, rng.normal(size=(4, 3, 3))
    wxyz, position = places(poses)
    assert wxyz.shape == (4, 3, 4)
    for index in np.ndindex(4, 3):
        # A browser's quaternion is of length 1 to the precision of float32.
        back = pose_of(1.001 * wxyz[index], position[index])
        np.testing.assert_allclose(back, poses[index], atol=1e-14)


@given(arrays(float, (3, 3), elements=st.floats(-1, 1)))
def test_an_ellipsoid_is_the_unit_sphere_stretched_and_turned(half):
    matrix = half @ half.T
    wxyz, axes = ellipsoid(matrix)
    turn = pose_of(wxyz, np.zeros(3))[:3, :3]
    np.testing.assert_allclose(turn @ np.diag(axes**2) @ turn.T, matrix, atol=1e-7)


# --- shapes


def test_each_link_of_a_niryo_is_drawn_where_its_capsules_are(session):
    model = collision.niryo_one()
    assert set(session.shape.meshes) == set(model.links)
    for link, mesh in session.shape.capsules().items():
        mine = [i for i, other in enumerate(model.links) if other == link]
        top = max(max(model.start[i, 2], model.end[i, 2]) + model.radius[i] for i in mine)
        assert mesh.vertices[:, 2].max() == pytest.approx(top, abs=2e-3)
    assert min(mesh.vertices[:, 2].min() for mesh in session.shape.meshes.values()) >= 0


@pytest.mark.parametrize("name", catalogue.names())
def test_every_arm_of_the_catalogue_has_a_shape(name):
    robot = catalogue.load(name)
    shape = shape_of(robot)
    assert all(0 <= link <= robot.joints for link in shape.meshes)
    assert all(volume(mesh) > 0 for mesh in shape.meshes.values())
    assert (shape.model is not None) == name.startswith("niryo_") * (name != "niryo_one_report")
    assert 0.1 < shape.reach < 10


URDF = """<robot name="two"><link name="base"><visual><geometry><box size="0.2 0.2 0.1"/></geometry>
</visual></link><link name="arm"><visual><origin xyz="0.5 0 0"/><geometry><sphere radius="0.1"/>
</geometry></visual></link><link name="finger"><visual><geometry><box size="0.1 0.1 0.1"/>
</geometry></visual></link>
<joint name="a" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 1"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="b" type="fixed"><parent link="arm"/><child link="finger"/><origin xyz="1 0 0"/></joint>
</robot>"""


def test_the_visual_geometry_of_a_description_is_drawn_where_it_is(tmp_path):
    pytest.importorskip("yourdfpy")
    path = tmp_path / "two.urdf"
    path.write_text(URDF)
    shape = shape_of(nj.robots.from_urdf(path), path)
    assert set(shape.meshes) == {0, 1}
    assert shape.model is None
    points = shape.meshes[1].vertices
    np.testing.assert_allclose(points.min(axis=0), [0.4, -0.1, 0.9], atol=1e-3)
    np.testing.assert_allclose(points.max(axis=0), [1.05, 0.1, 1.1], atol=1e-3)
    path.write_text(URDF.replace("<visual>", "<collision>").replace("</visual>", "</collision>"))
    assert set(shape_of(nj.robots.from_urdf(path), path).meshes) == {0, 1}
    path.write_text(URDF.replace("visual", "inertial"))
    assert shape_of(nj.robots.from_urdf(path), path).reach > 0


# --- what is shown


def check(view, robot):
    """What is told of a view is what other functions say, and what is drawn reaches the target."""
    truth = nj.inverse_kinematics(robot, view.target)
    assert int(np.sum(view.found)) == int(truth.count)
    assert view.complete == bool(truth.complete)
    every = np.concatenate([view.q[None], view.solutions.q])
    tool = product_of_exponentials(robot.screws, robot.home, every).astype(float)
    np.testing.assert_allclose(view.measures.tool, tool, atol=1e-12)
    links = view.measures.links
    np.testing.assert_allclose(links[:, -1] @ np.asarray(robot.home), tool, atol=1e-12)
    np.testing.assert_allclose(links[:, 0], np.broadcast_to(np.eye(4), (len(links), 4, 4)))
    reached = np.abs(tool[1:][view.found] - view.target).max(axis=(1, 2), initial=0.0)
    assert np.all(reached < 1e-6)
    measure = np.asarray(nj.manipulability(robot, every))
    np.testing.assert_allclose(view.measures.manipulability, measure, atol=1e-12)
    if view.chosen is not None:
        turns = (view.solutions.q[view.chosen] - view.q) / (2 * np.pi)
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-5)
        assert view.reached
    return view


def test_joints_show_their_own_solution_and_all_others(session, rng):
    robot = session.robot
    for q in rng.uniform(0.9 * robot.lower, 0.9 * robot.upper, (5, 6)):
        view = check(session.set_joints(q), robot)
        np.testing.assert_array_equal(view.q, q)
        assert view.chosen is not None
        assert view.within[view.chosen]


def test_clearance_and_ellipsoids_are_those_of_the_package(session, rng):
    robot, world = session.robot, session.shape.world
    q = rng.uniform(robot.lower, robot.upper)
    view = session.set_joints(q)
    apart = collision.distances(robot, collision.niryo_one(), q, world)
    assert view.clearance() == pytest.approx(float(np.min(apart.distance)), abs=1e-12)
    assert view.nearest_pair() == apart.nearest_pair()
    linear = np.asarray(nj.body_jacobian(robot, q))[3:]
    turn = view.measures.tool[0, :3, :3]
    np.testing.assert_allclose(view.measures.motion, turn @ linear @ linear.T @ turn.T, atol=1e-12)
    spread = uncertainty.propagate(robot, q, np.diag(np.arange(1.0, 7.0) * 1e-6))
    np.testing.assert_allclose(view.measures.error, spread.position_covariance, atol=1e-18)


def test_the_arm_follows_a_target_along_its_branch(session):
    view = session.set_joints(session.start)
    target, before = view.target, view
    for _ in range(20):
        target = target.copy()
        target[2, 3] -= 1e-3
        view = check(session.set_target(target), session.robot)
        assert view.reached
        assert view.chosen is not None
        assert np.max(np.abs(view.q - before.q)) < 0.1
        before = view


def test_the_arm_stays_where_a_target_cannot_be_reached(session):
    q = session.set_joints(session.start).q
    view = session.set_target(FAR)
    np.testing.assert_array_equal(view.q, q)
    assert not view.reached
    assert view.chosen is None
    assert not np.any(view.found)
    assert "cannot be reached" in view.message
    assert view.complete
    nonsense = session.set_target(np.full((4, 4), np.nan))
    assert "not a rigid motion" in nonsense.message
    np.testing.assert_array_equal(nonsense.q, q)
    assert np.all(np.isfinite(nonsense.measures.links))


def test_every_solution_can_be_chosen_and_no_empty_slot(session):
    session.set_joints(session.start)
    for slot in range(session.slots + 2):
        before = session.view
        view = session.choose(slot)
        if slot < session.slots and before.found[slot]:
            assert check(view, session.robot).chosen == slot
            np.testing.assert_array_equal(view.target, before.target)
        else:
            assert view is before
    assert session.choose(-1) is session.view


def test_colours_tell_branches_apart_and_grey_what_is_outside(session):
    view = session.set_joints(session.start)
    painted = [tuple(colour) for colour in colours_of(view).tolist()]
    inside = [painted[slot] for slot in np.flatnonzero(view.within)]
    assert len(set(inside)) == len(inside) > 1
    outside = np.flatnonzero(view.found & ~view.within)
    assert {painted[slot] for slot in outside} == {colours.OUTSIDE}
    assert colours.OUTSIDE not in inside
    assert len(set(colours.BRANCHES)) == 8
    assert colours.as_css((0, 255, 16)) == "#00ff10"


@pytest.mark.parametrize("name", ["abb_irb910sc", "rttr"])
def test_arms_of_other_kinds_are_shown_too(name):
    robot = catalogue.load(name)
    session = Session(robot)
    view = check(session.set_joints(session.start), robot)
    assert view.clearance() is None
    assert view.nearest_pair() is None
    assert np.any(session.slides) == ("prismatic" in robot.describe())
    assert np.all(np.isfinite(session.lower))
    assert np.all(session.lower <= session.upper)


@pytest.mark.parametrize("q", [np.zeros(5), np.full(6, np.nan), "six"])
def test_joints_that_are_none_are_refused(session, q):
    with pytest.raises((ValueError, TypeError), match="q: expected"):
        session.set_joints(q)


def test_a_covariance_that_is_none_is_refused():
    with pytest.raises(ValueError, match="covariance"):
        Session(nj.robots.niryo_one(), covariance=-np.eye(6))


def test_the_ends_of_sliders_are_within_the_limits(session):
    for unit in (np.deg2rad(1.0), 1e-3):
        least, most = ends_of(session.lower, session.upper, np.full(6, unit))
        assert np.all(least * unit >= session.lower - 1e-9)
        assert np.all(most * unit <= session.upper + 1e-9)
        assert np.all(least * unit - session.lower < 0.11 * unit)


# --- paths


def test_a_route_goes_straight_through_its_waypoints_and_no_joint_jumps(session):
    robot = session.robot
    first = session.set_joints(session.start).target
    # Back the same way: one program for both.
    second = first.copy()
    second[2, 3] -= 0.04
    waypoints = np.array([first, second, first])
    found = route.plan(robot, session.shape, waypoints, session.start)
    count = 2 * route.SAMPLES - 1
    assert found.reached == len(found.q) == count
    tool = product_of_exponentials(robot.screws, robot.home, found.q).astype(float)
    for at, pose in zip((0, route.SAMPLES - 1, -1), waypoints):
        np.testing.assert_allclose(tool[at], pose, atol=1e-6)
    assert np.ptp(tool[:, 0, 3]) < 1e-6
    assert np.max(np.abs(np.diff(found.q, axis=0))) < 0.1
    np.testing.assert_allclose(found.path.pieces[:, 0], tool[:-1, :3, 3], atol=1e-5)
    assert len(found.branches) >= 1
    for row, line in enumerate(found.branches, start=1):
        below = line.pieces[:, 0] - np.array([0.0, 0.0, row * 0.012 * session.shape.reach])
        away = np.linalg.norm(below[:, None] - tool[:, :3, 3], axis=-1).min(axis=1)
        assert np.all(away < 1e-5)


def test_a_branch_is_drawn_where_it_is_within_the_limits_and_nowhere_else(session):
    solutions = session.set_joints(session.start).solutions
    within = np.array([[1, 1], [1, 0], [1, 1], [0, 1]], bool)
    label = np.array([[0, 3], [3, 0], [0, 3], [0, 3]])
    four = dataclasses.replace(solutions, within_limits=within, label=label)
    position = np.arange(12.0).reshape(4, 3)
    zero, three = route.branch_lines(four, position, 0.5)
    # Branch 0 at samples 0 and 2, which do not follow each other; branch 3 at all.
    assert zero.pieces.shape == (0, 2, 3)
    assert three.colour == colours.of_branch(3)
    np.testing.assert_allclose(three.pieces[:, 0], position[:-1] + np.array([0, 0, 1.0]))


def test_one_waypoint_is_no_route():
    with pytest.raises(ValueError, match="waypoints: expected two or more, got 1"):
        route.straight(np.eye(4)[None])


# --- threads


def test_of_each_kind_the_newest_is_done_and_errors_end_nothing():
    done, errors, go = [], [], threading.Event()
    worker = Worker(errors.append)
    worker.post("first", lambda: go.wait(10))
    for number in range(5):
        worker.post("a", lambda number=number: done.append(("a", number)))
        worker.post("b", lambda number=number: done.append(("b", number)))
    worker.post("c", lambda: 1 / 0)
    go.set()
    assert worker.settle(10)
    assert done[-2:] == [("a", 4), ("b", 4)]
    assert len(done) <= 4
    assert [type(error) for error in errors] == [ZeroDivisionError]
    worker.close()
    worker.post("a", lambda: done.append("late"))
    assert "late" not in done


def test_a_task_ends_before_the_next_begins_and_tells_its_errors():
    events, errors = [], []
    task = Task(errors.append)

    def run(stop):
        events.append("begin")
        stop.wait(10)
        events.append("end")

    task.start(run)
    task.start(lambda stop: events.append("second"))
    task.stop()
    assert events == ["begin", "end", "second"]
    assert not task.running
    task.start(lambda stop: 1 / 0)
    while task.running:
        pass
    assert [type(error) for error in errors] == [ZeroDivisionError]


# --- maps


def test_voxels_are_cut_and_only_their_surface_is_drawn(rng):
    there = rng.uniform(size=(7, 6, 5)) < 0.8
    colour = rng.integers(0, 255, (7, 6, 5, 3)).astype(np.uint8)
    centres = tuple(np.arange(size) * 0.1 for size in there.shape)
    voxels = Voxels("x", 0.1, centres, there, colour, 0.0, 1.0)
    assert np.array_equal(voxels.cut(1, 0.0), there)
    assert not np.any(voxels.cut(2, 0.0))
    cut = voxels.cut(0, 0.5)
    assert np.array_equal(cut[:4], there[:4])
    assert not np.any(cut[4:])
    points, painted = voxels.surface(there)
    seen = set()
    for index in np.ndindex(*there.shape):
        beside = []
        for axis, step in np.ndindex(3, 2):
            other = list(index)
            other[axis] += 2 * step - 1
            outside = not 0 <= other[axis] < there.shape[axis]
            beside.append(not outside and there[tuple(other)])
        if there[index] and not all(beside):
            seen.add(index)
    drawn = [tuple(np.rint(point / 0.1).astype(int).tolist()) for point in points]
    assert len(drawn) == len(set(drawn))
    assert set(drawn) == seen
    for index, shade in zip(drawn, painted):
        assert np.array_equal(shade, colour[index])


# --- what is sent


@needs_viser
def test_ghosts_that_are_sent_reach_the_target_and_a_lost_client_is_not_missed(session):
    from benchmarks.viewer import Client, miss, swing
    from niryo_jax.viewer import Viewer

    with Viewer(session.robot, shape=session.shape, port=0) as viewer:
        poses = swing(viewer.view.target, 30)
        lost = Client(viewer)
        assert lost.ghosts(10) is not None or viewer.settle()
        lost.drag(poses[1])
        lost.close()
        client = Client(viewer)
        while client.ghosts(0.5) is not None:
            pass
        for pose in poses[2:]:
            client.drag(pose)
            sent = client.ghosts(30)
            assert sent is not None
            assert miss(viewer, pose, sent) < 2e-6
        # Of many at once the last is shown.
        for pose in poses:
            client.drag(pose)
        while client.ghosts(0.5) is not None:
            pass
        np.testing.assert_allclose(viewer.view.target, poses[-1], atol=1e-12)
        client.close()


# --- the command


@needs_viser
def test_a_port_that_is_taken_is_named(cli):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        code, out, err = cli("view", "--port", port, "--no-browser")
    assert (code, out) == (2, "")
    assert f"cannot listen on 127.0.0.1:{port}" in err
    assert "--port" in err


@needs_viser
@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("nonsense",), 2, "nonsense"),
        (("--map", "/nowhere/at/all"), 6, "no such store"),
        (("--host", "127.0.0.1:9"), 4, "127.0.0.1:9"),
        (("--bind", "203.0.113.1"), 2, "cannot listen on 203.0.113.1"),
        (("--port", "70000"), 2, "70000"),
    ],
)
def test_mistakes_are_told_in_a_sentence(cli, arguments, code, said):
    if "--host" in arguments:
        pytest.importorskip("pyniryo")
    if "--map" in arguments:
        pytest.importorskip("zarr")
    found, out, err = cli("view", *arguments, *(() if "--port" in arguments else ("--port", 0)))
    assert (found, out) == (code, "")
    assert said in err
    assert "Traceback" not in err


def test_without_the_extra_one_line_says_what_to_install(cli, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    code, out, err = cli("view")
    assert (code, out) == (5, "")
    assert 'pip install "niryo_jax[viewer]"' in err


def test_the_port_of_the_command_is_that_of_the_viewer():
    pytest.importorskip("typer")
    from niryo_jax.cli import view
    from niryo_jax.viewer import PORT

    assert inspect.signature(view.view).parameters["port"].default == PORT


def test_importing_it_needs_no_viser():
    code = "import sys; sys.modules['viser'] = None; import niryo_jax.viewer"
    subprocess.run([sys.executable, "-c", code], check=True)


@needs_viser
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_it(number, tmp_path):
    command = [sys.executable, "-m", "niryo_jax.cli", "view", "--port", "0", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as it:
        assert it.stdout is not None
        assert it.stderr is not None
        said = ""
        while not said.endswith("}\n"):
            said += it.stdout.readline()
        document = json.loads(said)
        assert document["url"].startswith("http://127.0.0.1:")
        it.send_signal(number)
        rest, err = it.communicate(timeout=60)
    assert (it.returncode, rest, err) == (0, "", "")
