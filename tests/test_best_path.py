"""The best continuous path through poses: of all ways, the cheapest; where there is none, why."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import niryo_jax as nj
from niryo_jax.collision import World, niryo_one
from niryo_jax.motion import PathCost, best_path
from niryo_jax.motion.ladder import Prices, Rungs, Turns, cheapest

SAMPLES = 60
TURN = 2 * np.pi


def line(start, end, rotation, count=SAMPLES):
    """Poses along a straight line, metres."""
    pose = np.tile(np.eye(4), (count, 1, 1))
    pose[:, :3, :3] = rotation
    share = np.linspace(0, 1, count)[:, None]
    pose[:, :3, 3] = (1 - share) * np.asarray(start) + share * np.asarray(end)
    return pose


def turning(pose, angle, count=SAMPLES):
    """Poses that turn about the tool's z axis."""
    out = np.tile(np.eye(4), (count, 1, 1))
    for i, x in enumerate(np.linspace(0, angle, count)):
        out[i, :2, :2] = [[np.cos(x), -np.sin(x)], [np.sin(x), np.cos(x)]]
    return np.asarray(pose) @ out


def check(robot, poses, path, largest_step=0.5):
    """A path that is done does its poses, without a jump, within the limits."""
    assert path.ok
    np.testing.assert_allclose(nj.forward_kinematics(robot, path.q), poses, atol=1e-9)
    assert np.max(np.abs(np.diff(path.q, axis=0))) <= largest_step
    assert np.all((path.q >= robot.lower - 1e-9) & (path.q <= robot.upper + 1e-9))


@pytest.fixture(scope="module")
def niryo():
    return nj.robots.niryo_one()


@pytest.fixture(scope="module")
def ahead(niryo):
    """The rotation of the tool at q = 0."""
    return np.asarray(nj.forward_kinematics(niryo, np.zeros(6)))[:3, :3]


@pytest.mark.parametrize("seed", range(6))
def test_of_all_ways_it_is_the_cheapest(seed):
    # Joint 1 has two copies of each angle, joint 2 one, joint 3 no limits: all ways are tried.
    rng = np.random.default_rng(seed)
    turns = Turns((2, 1, 0), (True, True, True))
    lower, upper = np.array([-TURN, -3.0, -np.inf]), np.array([TURN, 3.0, np.inf])
    count, m = 4, 3
    low = np.array([-TURN, -3.0, -np.pi])
    q = low + rng.uniform(0, [TURN, 6.0, TURN], (count, m, 3))
    usable = rng.uniform(size=(count, m)) < 0.9
    price = rng.uniform(0, 0.3, (count, m))
    barred = rng.uniform(size=(count - 1, m, m)) < 0.1
    travel, limits, step = np.array([1.0, 2.0, 0.5]), 0.1, 2.5
    best = np.inf
    half = 0.5 * (upper - lower)[:2]
    for places in itertools.product(range(m), repeat=count):
        for copies in itertools.product((0, 1), repeat=count):
            total, before = 0.0, None
            for at, (place, copy) in enumerate(zip(places, copies)):
                here = q[at, place] + [TURN * copy, 0, 0]
                inside = np.all((here >= lower) & (here <= upper))
                if not usable[at, place] or not inside:
                    break
                total += price[at, place] + limits * np.sum((here[:2] / half) ** 2)
                if before is not None:
                    change = here - before
                    change[2] -= TURN * np.round(change[2] / TURN)
                    if np.max(np.abs(change)) > step or barred[at - 1, place, places[at - 1]]:
                        break
                    total += np.sum(travel * change**2)
                before = here
            else:
                best = min(best, total)
    nothing = jnp.zeros((1, m, 2))
    arrays = (jnp.asarray(x)[None] for x in (q, usable, price, barred))
    prices = Prices(*map(jnp.asarray, (travel, limits, step, lower, upper)))
    way = cheapest(Rungs(*arrays, nothing, nothing), prices, turns)
    np.testing.assert_allclose(way.cost[0], best, rtol=1e-12)
    assert (int(way.reached[0]) == count) == np.isfinite(best)


def test_a_line_is_done_exactly_and_as_follow_does_it(niryo, ahead):
    poses = line([0.25, -0.15, 0.2], [0.25, 0.15, 0.2], ahead)
    path = best_path(niryo, poses)
    check(niryo, poses, path, 0.1)
    assert path.proved
    assert path.reached == SAMPLES
    assert "whole path" in path.message
    followed = nj.follow(niryo, poses, path.q[0])
    np.testing.assert_allclose(followed.q, path.q, atol=1e-9)
    # There and back again is a loop of the joints as well.
    loop = np.concatenate([poses[:30], poses[29::-1]])
    back = best_path(niryo, loop, closed=True)
    check(niryo, loop, back, 0.1)
    assert back.returns
    np.testing.assert_allclose(back.q[0], back.q[-1], atol=1e-9)


def test_a_line_that_one_branch_cannot_finish_is_done_on_another(niryo):
    rng = np.random.default_rng(4)
    saved = 0
    q = rng.uniform(niryo.lower, niryo.upper, (2, 64, 6))
    q[1] = np.clip(q[0] + rng.uniform(-1, 1, (64, 6)), niryo.lower, niryo.upper)
    a, b = np.asarray(nj.forward_kinematics(niryo, q))
    poses = np.stack([line(x[:3, 3], y[:3, 3], x[:3, :3]) for x, y in zip(a, b)])
    paths = best_path(niryo, poses)
    for i in np.nonzero(paths.ok)[0]:
        starts = nj.inverse_kinematics(niryo, poses[i, 0])
        inside = np.asarray(starts.q)[np.asarray(starts.within_limits)]
        followed = [nj.follow(niryo, poses[i], start) for start in inside[:2]]
        saved += not np.all(followed[0].ok)
        if saved:
            break
    assert saved >= 1
    assert np.all(paths.proved)
    single = best_path(niryo, poses[0])
    assert single.ok == paths.ok[0]
    np.testing.assert_allclose(single.q, paths.q[0], atol=1e-9)
    assert paths.message.startswith(f"{int(paths.ok.sum())} of 64")


def test_where_there_is_no_path_it_says_where_all_branches_end_and_why(niryo, ahead):
    poses = line([0.25, 0.0, 0.2], [0.25, 0.6, 0.2], ahead)
    path = best_path(niryo, poses)
    reachable = np.asarray(nj.inverse_kinematics(niryo, poses).within_limits).any(axis=1)
    assert not path.ok
    assert path.proved
    assert np.isinf(path.cost)
    assert path.reached == reachable.argmin()
    assert f"before sample {path.reached} of 0 to 59" in path.message
    np.testing.assert_allclose(
        path.q[path.reached :], np.tile(path.q[path.reached - 1], (60 - int(path.reached), 1))
    )
    path = best_path(niryo, poses[::-1])
    assert path.reached == 0
    assert path.message.startswith("No branch begins")


def test_whole_turns_are_looked_ahead():
    robot = nj.robots.load("ur16e")
    q = np.array([1.0, -1.5, 1.2, 0.3, 0.8, 2.9])
    pose = nj.forward_kinematics(robot, q)
    # Joint 6 has this far to go only from the lower of its two copies.
    poses = turning(pose, 3.0 * np.pi)
    path = best_path(robot, poses)
    check(robot, poses, path)
    assert np.ptp(path.q[:, 5]) > 9
    assert not path.returns
    poses = turning(pose, 3.2 * np.pi)
    path = best_path(robot, poses)
    assert not path.ok
    assert "joint_6" in path.message
    # Once round is a closed path of the tool, from which joint 6 does not return.
    poses = turning(pose, TURN)
    assert best_path(robot, poses).ok
    assert not best_path(robot, poses).returns
    closed = best_path(robot, poses, closed=True)
    assert not closed.ok
    assert "began with" in closed.message


def test_it_goes_through_a_singular_wrist():
    robot = nj.robots.load("abb_irb120")
    q = np.tile([0.3, 0.2, 0.1, 0.4, 0.0, 0.3], (61, 1))
    q[:, 4] = np.linspace(-0.5, 0.5, 61)
    path = best_path(robot, nj.forward_kinematics(robot, q))
    assert path.ok
    np.testing.assert_allclose(path.q, q, atol=1e-6)


def test_what_stands_in_the_way_is_kept_away_from(niryo, ahead):
    poses = line([0.25, -0.15, 0.2], [0.25, 0.15, 0.2], ahead)
    model = niryo_one()
    free = best_path(niryo, poses, collision=model)
    check(niryo, poses, free)
    away = nj.collision.clearance(niryo, model, free.q)
    assert np.all(away > 0)
    ball = World.spheres([[0.25, 0.0, 0.2]], [0.03])
    blocked = best_path(niryo, poses, collision=model, world=ball)
    assert not blocked.ok
    assert 0 < blocked.reached < SAMPLES
    assert "collide" in blocked.message
    # A price on clearance makes it no smaller.
    apart = World.spheres([[0.12, 0.0, 0.45]], [0.03])
    dear = PathCost(travel=1e-3, clearance=10.0, comfort=0.2)
    near, far = (
        best_path(niryo, poses, collision=model, world=apart, cost=cost)
        for cost in (PathCost(), dear)
    )
    least = [float(np.min(nj.collision.clearance(niryo, model, x.q, apart))) for x in (near, far)]
    assert least[1] >= least[0] - 1e-9


def test_a_tool_that_may_turn_does_more_and_a_seventh_joint_is_sampled(niryo, ahead):
    poses = line([0.25, -0.15, 0.2], [0.25, 0.3, 0.2], ahead, 16)
    path = best_path(niryo, poses, task="direction", tool_axis=(1, 0, 0), values=8)
    assert path.ok
    reached = np.asarray(nj.forward_kinematics(niryo, path.q))
    np.testing.assert_allclose(reached[:, :3, 3], poses[:, :3, 3], atol=1e-9)
    np.testing.assert_allclose(reached[:, :3, 0], poses[:, :3, 0], atol=1e-9)
    assert not path.proved
    robot = nj.robots.load("kuka_iiwa14")
    pose = np.asarray(nj.forward_kinematics(robot, [0.2, 0.5, 0.3, -1.2, 0.4, 0.8, 0.1]))
    poses = line(pose[:3, 3], pose[:3, 3] + [0.0, 0.2, -0.1], pose[:3, :3], 16)
    check(robot, poses, best_path(robot, poses, values=16))


def test_wrong_use_is_refused_by_name(niryo, ahead):
    poses = line([0.25, -0.15, 0.2], [0.25, 0.15, 0.2], ahead)
    for wrong, words in [
        ({"poses": poses[:1]}, "poses: expected shape"),
        ({"largest_step": 0.0}, "largest_step"),
        ({"q_start": np.zeros(5)}, "q_start: expected shape"),
        ({"q_start": np.full(6, np.nan)}, "q_start: expected finite"),
        ({"task": "position"}, "task: expected"),
        ({"world": World.table(0.0)}, "collision: expected the shape"),
        ({"cost": PathCost(travel=-1.0)}, "cost.travel"),
        ({"cost": PathCost(limits=-1.0)}, "cost.limits"),
        ({"values": 1}, "values"),
    ]:
        with pytest.raises(ValueError, match=words):
            best_path(niryo, **{"poses": poses, **wrong})
    with pytest.raises(TypeError, match="cost: expected a PathCost"):
        best_path(niryo, poses, cost=1.0)
    with pytest.raises(TypeError, match="collision: expected a CollisionModel"):
        best_path(niryo, poses, collision=3)
    with pytest.raises(TypeError, match="concrete"):
        jax.jit(lambda x: best_path(niryo, x).q)(poses)
