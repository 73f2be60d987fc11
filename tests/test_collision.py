"""Collisions: distances against brute force in extended precision, coal, laws and differences."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import BATCHES, LD, product_of_exponentials, random_poses, random_robot, unit_vectors

import niryo_jax as nj
from niryo_jax import collision as co
from niryo_jax.hardware.pick_and_place import AT_REST
from niryo_jax.robots.niryo import MODELS

NIRYO = nj.robots.niryo_one()
SHAPES = {
    "niryo_one": co.niryo_one,
    "niryo_ned": co.niryo_ned,
    "niryo_ned2": co.niryo_ned2,
}
Q = np.array([0.3, -0.2, 0.4, 0.5, -0.6, 0.7])
FOLDED = np.array([0.2, 0.6, -1.35, 0.4, -0.9, 0.1])

# Three joints, for programs of traced screws take long to compile.
SMALL = nj.Robot.from_axes(
    axes=np.eye(3)[[2, 1, 1]],
    points=np.array([[0, 0, 0], [0, 0, 0.2], [0.3, 0, 0.2]]),
    home=np.array([[1.0, 0, 0, 0.5], [0, 1, 0, 0.1], [0, 0, 1, 0.2], [0, 0, 0, 1]]),
)
SMALL_Q = np.array([0.3, -0.4, 2.3])
SMALL_MODEL = co.CollisionModel.from_capsules(
    start=np.array([[0, 0, 0.0], [0, 0, 0.2], [0.31, 0.02, 0.21], [0.5, 0, 0.22]]),
    end=np.array([[0, 0, 0.1], [0.3, 0, 0.2], [0.5, 0.1, 0.2], [0.5, 0, 0.22]]),
    radius=[0.05, 0.04, 0.03, 0.02],
    links=[0, 1, 3, 3],
    pairs=[(0, 3), (1, 3)],
)
BOX = random_poses(np.random.default_rng(8)).astype(float)
BOX[:3, 3] = [0.25, 0.1, 0.45]
WORLD = (
    co.World.table(-0.1)
    + co.World.boxes(BOX[None], [[0.05, 0.1, 0.08]], ignored=[0])
    + co.World.spheres([[0.3, -0.3, 0.3]], [0.1])
    + co.World.capsules([[-0.3, 0.4, 0.0]], [[-0.3, 0.4, 0.6]], [0.04], names=["post"])
)


def dot(a, b):
    return np.sum(a * b, axis=-1)


def segments_truth(a0, a1, b0, b1):
    """The distance of segments: the least of those at the ends, and of the lines."""
    a0, a1, b0, b1 = (np.asarray(x, LD) for x in (a0, a1, b0, b1))
    u, v, r = a1 - a0, b1 - b0, a0 - b0
    uu, vv = (np.where(x > 0, x, 1) for x in (dot(u, u), dot(v, v)))
    best = np.full(r.shape[:-1], np.inf, LD)

    def at(s, t):
        s, t = np.clip(s, 0, 1), np.clip(t, 0, 1)
        gap = r + s[..., None] * u - t[..., None] * v
        return np.minimum(best, np.sqrt(dot(gap, gap)))

    for value in (0.0, 1.0):
        end = np.full(best.shape, value, LD)
        best = at(end, dot(v, r + end[..., None] * u) / vv)
        best = at(dot(u, end[..., None] * v - r) / uu, end)
    across = v - (dot(u, v) / uu)[..., None] * u
    across = across - (dot(u, across) / uu)[..., None] * u
    aside = r - (dot(u, r) / uu)[..., None] * u
    square = dot(across, across)
    t = np.clip(dot(aside, across) / np.where(square > 0, square, 1), 0, 1)
    return at(dot(u, t[..., None] * v - r) / uu, t)


def random_segments(rng, count):
    """Segments of which half are nearly parallel, some of these meet, and some are points."""
    a0, a1, b0, b1 = rng.uniform(-1, 1, (4, count, 3))
    half, quarter = count // 2, count // 4
    along = (a1 - a0)[:half] * rng.uniform(-1.5, 1.5, (half, 1))
    angle = 10.0 ** rng.uniform(-14, -2, (half, 1))
    along = along + angle * np.linalg.norm(along, axis=1, keepdims=True) * rng.standard_normal(
        (half, 3)
    )
    meeting = a0[:quarter] + rng.uniform(0, 1, (quarter, 1)) * (a1 - a0)[:quarter]
    b0[:quarter] = meeting - rng.uniform(-0.2, 1.2, (quarter, 1)) * along[:quarter]
    aside = 10.0 ** rng.uniform(-13, -1, (quarter // 2, 1))
    b0[: quarter // 2] += aside * rng.standard_normal((quarter // 2, 3))
    b1[:half] = b0[:half] + along
    a1[half : half + 50] = a0[half : half + 50]
    b1[half + 25 : half + 75] = b0[half + 25 : half + 75]
    return a0, a1, b0, b1


def test_segments_are_as_far_apart_as_brute_force_finds(rng):
    given = random_segments(rng, 100_000)
    truth = segments_truth(*given)
    found = np.asarray(co.segment_distance(*given))
    np.testing.assert_allclose(found, truth.astype(float), rtol=0, atol=2e-15)
    swapped = co.segment_distance(*given[2:], *given[:2])
    np.testing.assert_allclose(swapped, found, rtol=0, atol=2e-15)
    single = co.segment_distance(*(x.astype(np.float32) for x in given))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, truth.astype(float), rtol=0, atol=2e-6)


def coal_frame(coal, a, b):
    """A capsule of coal lies along z about its middle."""
    z = b - a
    length = np.linalg.norm(z)
    z = z / length
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return coal.Transform3s(np.stack([x, np.cross(z, x), z], 1), (a + b) / 2), length


def test_coal_agrees_on_capsules(rng):
    coal = pytest.importorskip("coal")
    a0, a1, b0, b1 = rng.uniform(-1, 1, (4, 2000, 3))
    found = np.asarray(co.segment_distance(a0, a1, b0, b1)) - 0.08
    theirs = []
    for ends in zip(a0, a1, b0, b1):
        (first, length), (second, other) = (coal_frame(coal, *x) for x in (ends[:2], ends[2:]))
        shapes = coal.Capsule(0.05, length), coal.Capsule(0.03, other)
        result = coal.DistanceResult()
        theirs.append(
            coal.distance(shapes[0], first, shapes[1], second, coal.DistanceRequest(), result)
        )
    # Most agree to rounding; the iteration of coal ends at 1e-6.
    apart = np.abs(found - theirs)
    assert np.max(apart) < 1e-6
    assert np.quantile(apart, 0.8) < 1e-12


def box_truth(start, end, pose, half):
    """The least signed distance of many points of a segment, refined around the best of them."""
    start, end = (
        np.einsum("nji,nj->ni", pose[:, :3, :3], x - pose[:, :3, 3]) for x in (start, end)
    )
    low, high = np.zeros(len(start)), np.ones(len(start))
    for _ in range(22):
        t = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, 11)
        point = start[:, None] + t[..., None] * (end - start)[:, None]
        beyond = np.abs(point) - half[:, None]
        outside = np.linalg.norm(np.maximum(beyond, 0), axis=-1)
        signed = np.where(np.max(beyond, axis=-1) > 0, outside, np.max(beyond, axis=-1))
        best = np.argmin(signed, axis=1)
        step = (high - low) / 10
        middle = np.take_along_axis(t, best[:, None], 1)[:, 0]
        low, high = np.clip(middle - step, 0, 1), np.clip(middle + step, 0, 1)
    return np.min(signed, axis=1)


def box_cases(rng, count):
    pose = random_poses(rng, (count,)).astype(float)
    pose[: count // 4, :3, :3] = np.eye(3)
    half = rng.uniform(0.05, 0.6, (count, 3))
    start, end = rng.uniform(-1, 1, (2, count, 3))
    end[: count // 8] = start[: count // 8] + np.eye(3)[rng.integers(0, 3, count // 8)]
    end[count // 2 : count // 2 + 50] = start[count // 2 : count // 2 + 50]
    # Inside, too.
    start[-count // 3 :] = pose[-count // 3 :, :3, 3] + 0.3 * start[-count // 3 :]
    end[-count // 3 :] = pose[-count // 3 :, :3, 3] + 0.3 * end[-count // 3 :]
    return start, end, pose, half


def test_boxes_are_as_far_from_segments_as_brute_force_finds(rng):
    given = box_cases(rng, 4000)
    truth = box_truth(*given)
    assert np.mean(truth < 0) > 0.2
    np.testing.assert_allclose(co.box_distance(*given), truth, rtol=0, atol=1e-13)
    single = co.box_distance(*(x.astype(np.float32) for x in given))
    np.testing.assert_allclose(single, truth, rtol=0, atol=3e-6)


def test_a_point_in_a_box_is_as_deep_as_the_nearest_face():
    point, pose = np.array([0.1, 0.0, -0.25]), np.eye(4)
    assert co.box_distance(point, point, pose, np.full(3, 0.3)) == pytest.approx(-0.05, abs=1e-15)
    # A segment through a box: half way through the face that is nearest to its deepest point.
    ends = np.array([-1.0, 0.02, 0.0]), np.array([1.0, 0.02, 0.0])
    assert co.box_distance(*ends, pose, np.array([0.3, 0.1, 0.4])) == pytest.approx(-0.08)


def moved(pose, points):
    return np.asarray(points, LD) @ pose[..., :3, :3].swapaxes(-1, -2) + pose[..., None, :3, 3]


def pairs_truth(robot, model, q):
    """(p,) the distances of a model's pairs, by forward kinematics in extended precision."""
    q = np.asarray(q, LD)
    ends = []
    for start, end, link in zip(model.start, model.end, model.links):
        pose = np.eye(4, dtype=LD)
        if link:
            pose = product_of_exponentials(robot.screws[:link], np.eye(4), q[:link])
        ends.append(moved(pose, [start, end]))
    return np.array(
        [
            segments_truth(*ends[i], *ends[j]) - model.radius[i] - model.radius[j]
            for i, j in model.pairs
        ]
    )


@functools.cache
def random_arm():
    rng = np.random.default_rng(3)
    robot = random_robot(rng, 4, prismatic=[1], helical=[2])
    start, end = rng.uniform(-1, 1, (2, 5, 3))
    return robot, co.CollisionModel.from_capsules(start, end, 0.05, [0, 1, 2, 3, 4])


@pytest.mark.parametrize("which", ["niryo", "random"])
def test_distances_are_those_of_the_moved_segments(which):
    robot, model = (NIRYO, co.niryo_one("gripper_1")) if which == "niryo" else random_arm()
    q = np.random.default_rng(4).uniform(-1, 1, (3, 2, robot.joints))
    truth = np.array([[pairs_truth(robot, model, x) for x in row] for row in q])
    found = co.distances(robot, model, q)
    np.testing.assert_allclose(found.distance, truth.astype(float), rtol=0, atol=5e-15)
    assert found.pairs == model.pair_names()
    least = co.clearance(robot, model, q)
    np.testing.assert_allclose(least, np.min(truth, -1).astype(float), rtol=0, atol=5e-15)
    index = tuple(np.unravel_index(np.argmin(least), least.shape))
    number = int(np.argmin(truth[index]))
    assert found.nearest_pair(index) == model.pair_names()[number]
    np.testing.assert_array_equal(found.nearest, np.argmin(truth, -1))
    np.testing.assert_array_equal(co.collides(robot, model, q), np.min(truth, -1) <= 0)


def world_truth(robot, model, q, world):
    """The distances to each obstacle by the public functions of segments and boxes."""
    out, names = [], iter(zip(world.names, world.ignored))
    poses = [np.eye(4), *np.asarray(nj.link_poses(robot, q))]
    ends = [
        [pose[:3, :3] @ x + pose[:3, 3] for x in (start, end)]
        for start, end, pose in zip(model.start, model.end, (poses[i] for i in model.links))
    ]

    def each(measure):
        _, ignored = next(names)
        for (start, end), radius, link in zip(ends, model.radius, model.links):
            if link not in ignored:
                out.append(float(measure(start, end)) - radius)

    for normal, offset in zip(world.plane_normals, world.plane_offsets):
        each(lambda a, b, n=normal, o=offset: min(n @ a, n @ b) - o)
    for pose, half in zip(world.box_poses, world.box_half_sizes):
        each(lambda a, b, p=pose, h=half: co.box_distance(a, b, p, h))
    for centre, radius in zip(world.sphere_centres, world.sphere_radii):
        each(lambda a, b, c=centre, r=radius: segments_truth(a, b, c, c) - r)
    for start, end, radius in zip(world.capsule_starts, world.capsule_ends, world.capsule_radii):
        each(lambda a, b, s=start, e=end, r=radius: segments_truth(a, b, s, e) - r)
    return np.array(out)


def test_obstacles_have_the_distances_of_their_shapes():
    found = co.distances(SMALL, SMALL_MODEL, SMALL_Q, WORLD)
    truth = world_truth(SMALL, SMALL_MODEL, SMALL_Q, WORLD)
    own = len(SMALL_MODEL.pairs)
    np.testing.assert_allclose(found.distance[own:], truth, rtol=0, atol=1e-13)
    obstacles = ["table", "box_1", "sphere_1", "post"]
    assert list(dict.fromkeys(b for _, b in found.pairs[own:])) == obstacles
    assert ("link_0", "table") not in found.pairs
    assert ("link_0", "post") in found.pairs
    least = co.clearance(SMALL, SMALL_MODEL, SMALL_Q, WORLD)
    assert float(least) == pytest.approx(float(np.min(found.distance)), abs=1e-15)


def test_many_obstacles_are_each_looked_at(rng):
    world = (
        co.World.spheres(rng.uniform(-1, 1, (7, 3)), rng.uniform(0, 0.1, 7))
        + co.World.spheres(rng.uniform(-1, 1, (2, 3)), [0.1, 0.2], ignored=[0, 1])
        + co.World.planes(unit_vectors(rng, (6,)).astype(float), np.full(6, -0.9))
    )
    q = rng.uniform(-1, 1, (4, 3))
    found = co.distances(SMALL, SMALL_MODEL, q, world)
    truth = np.array([world_truth(SMALL, SMALL_MODEL, x, world) for x in q])
    np.testing.assert_allclose(found.distance[:, len(SMALL_MODEL.pairs) :], truth, atol=1e-13)
    least = np.min(found.distance, axis=-1)
    np.testing.assert_allclose(co.clearance(SMALL, SMALL_MODEL, q, world), least, atol=1e-13)


def test_growing_lowers_the_distance_by_as_much():
    model = dataclasses.replace(SMALL_MODEL, radius=SMALL_MODEL.radius + 0.01)
    before, after = (
        co.distances(SMALL, shape, SMALL_Q, WORLD).distance for shape in (SMALL_MODEL, model)
    )
    own = len(model.pairs)
    np.testing.assert_allclose(before[:own] - after[:own], 0.02, atol=1e-15)
    np.testing.assert_allclose(before[own:] - after[own:], 0.01, atol=1e-15)


def test_a_rigid_motion_of_everything_changes_nothing(rng):
    given = random_segments(rng, 1000)
    pose = random_poses(rng).astype(float)
    turned = (x @ pose[:3, :3].T + pose[:3, 3] for x in given)
    np.testing.assert_allclose(
        co.segment_distance(*turned), co.segment_distance(*given), rtol=0, atol=2e-15
    )
    start, end, box, half = box_cases(rng, 500)
    other = (x @ pose[:3, :3].T + pose[:3, 3] for x in (start, end))
    np.testing.assert_allclose(
        co.box_distance(*other, pose @ box, half),
        co.box_distance(start, end, box, half),
        atol=5e-15,
    )


def test_what_contains_another_is_no_farther(rng):
    a0, a1, b0, b1 = random_segments(rng, 1000)
    part = a0 + 0.3 * (a1 - a0), a0 + 0.8 * (a1 - a0)
    assert np.all(co.segment_distance(*part, b0, b1) >= co.segment_distance(a0, a1, b0, b1) - 1e-15)
    start, end, box, half = box_cases(rng, 500)
    smaller = co.box_distance(start, end, box, 0.7 * half)
    assert np.all(smaller >= co.box_distance(start, end, box, half) - 1e-15)


def differences(function, x, step=1e-6):
    x = np.asarray(x, float)
    out = np.empty(x.shape)
    for i in np.ndindex(x.shape):
        unit = np.zeros(x.shape)
        unit[i] = step
        out[i] = (float(function(x + unit)) - float(function(x - unit))) / (2 * step)
    return out


@functools.cache
def gradients():
    """Of the clearance by the joints, the arm, the model and the world."""
    return jax.jit(
        jax.grad(
            lambda q, robot, model, world: co.clearance(robot, model, q, world),
            argnums=(0, 1, 2, 3),
        )
    )


PLACES = {
    ("link_1", "link_3"): (np.array([1.11, 0.13, -0.95]), None),
    ("link_3", "table"): (np.array([-2.42, 1.57, 2.06]), "plane_offsets"),
    ("link_1", "box_1"): (np.array([0.36, -2.47, 1.36]), "box_half_sizes"),
    # With its segment in the box, and beside it.
    ("link_3", "box_1"): (np.array([0.47, -0.81, -0.54]), "box_half_sizes"),
    ("link_3_2", "box_1"): (np.array([1.73, -0.89, -1.73]), "box_half_sizes"),
    ("link_3", "sphere_1"): (np.array([-0.96, -0.63, 0.98]), "sphere_centres"),
    ("link_3", "post"): (np.array([1.94, 0.66, -0.72]), "capsule_ends"),
}
"""For each pair joints at which it is the nearest, and what to change of the world."""


@pytest.mark.parametrize("pair", PLACES, ids="-".join)
def test_derivatives_are_those_of_differences(pair):
    q, field = PLACES[pair]
    found = gradients()(q, SMALL, SMALL_MODEL, WORLD)

    def least(q=q, model=SMALL_MODEL, world=WORLD):
        return co.clearance(SMALL, model, q, world)

    assert co.distances(SMALL, SMALL_MODEL, q, WORLD).nearest_pair() == pair
    np.testing.assert_allclose(found[0], differences(lambda x: least(q=x), q), atol=1e-7)
    # Both ends together: a sphere becomes longer where one of them goes any way.
    expected = differences(
        lambda x: least(
            model=dataclasses.replace(
                SMALL_MODEL, start=SMALL_MODEL.start + x, end=SMALL_MODEL.end + x
            )
        ),
        np.zeros((4, 3)),
    )
    np.testing.assert_allclose(found[2].start + found[2].end, expected, atol=1e-7)
    expected = differences(
        lambda x: least(model=dataclasses.replace(SMALL_MODEL, radius=x)), SMALL_MODEL.radius
    )
    np.testing.assert_allclose(found[2].radius, expected, atol=1e-7)
    if field is not None:
        expected = differences(
            lambda x: least(world=dataclasses.replace(WORLD, **{field: x})), getattr(WORLD, field)
        )
        np.testing.assert_allclose(getattr(found[3], field), expected, atol=1e-7)
    # The arm's geometry: by moving the last screw along itself.
    screws = np.asarray(found[1].screws)
    step = np.zeros((3, 6))
    step[2, 3:] = [0.3, 0.0, -0.2]
    ahead, behind = (
        co.clearance(
            dataclasses.replace(SMALL, screws=jnp.asarray(SMALL.screws + sign * 1e-6 * step)),
            SMALL_MODEL,
            q,
            WORLD,
        )
        for sign in (1, -1)
    )
    assert np.sum(screws * step) == pytest.approx(float(ahead - behind) / 2e-6, abs=1e-7)


def test_derivatives_of_all_distances_are_those_of_differences():
    def of(q):
        return co.distances(SMALL, SMALL_MODEL, q, WORLD).distance

    found = np.asarray(jax.jit(jax.jacfwd(of))(SMALL_Q))
    step = 1e-6 * np.eye(3)
    expected = np.stack([(of(SMALL_Q + x) - of(SMALL_Q - x)) / 2e-6 for x in step], -1)
    np.testing.assert_allclose(found, expected, atol=1e-7)


DEGENERATE = {
    "crossing": ([-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0]),
    "the same": ([-1, 0, 0], [1, 0, 0], [-1, 0, 0], [1, 0, 0]),
    "parallel": ([-1, 0, 0], [1, 0, 0], [-0.5, 1, 0], [0.7, 1, 0]),
    "in line": ([-1, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]),
    "points": ([0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0]),
    "one point": ([0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]),
    "point on it": ([-1, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 0]),
}


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_no_derivative_is_nan(dtype):
    ends = [np.array(x, dtype) for x in zip(*DEGENERATE.values())]
    slopes = jax.jit(jax.grad(lambda *x: co.segment_distance(*x).sum(), argnums=(0, 1, 2, 3)))
    assert all(np.all(np.isfinite(slope)) for slope in slopes(*ends))
    # Segments and points on, in and beside a box: through its centre, along faces and edges.
    half = np.ones((8, 3), dtype)
    start = np.array(
        [[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 1, 1], [-2, 0, 0], [-2, 1, 1], [2, 2, 2], [0, 0, 3]]
    )
    end = start + np.array(
        [[0, 0, 0], [0.5, 0, 0], [0, 0, 0], [0, 0, 0], [4, 0, 0], [4, 0, 0], [0, 0, 1], [1, 0, 0]]
    )
    pose = np.broadcast_to(np.eye(4, dtype=dtype), (8, 4, 4))
    slopes = jax.jit(jax.grad(lambda *x: co.box_distance(*x).sum(), argnums=(0, 1, 2, 3)))
    found = slopes(start.astype(dtype), end.astype(dtype), pose, half)
    assert all(np.all(np.isfinite(slope)) for slope in found)


def test_a_nan_joint_is_never_free():
    for joint in range(6):
        q = Q.copy()
        q[joint] = np.nan
        assert np.isnan(co.clearance(NIRYO, co.niryo_one(), q))
        assert bool(co.collides(NIRYO, co.niryo_one(), q))


@pytest.mark.parametrize("batch", BATCHES)
def test_batches(batch, rng):
    q = rng.uniform(-1, 1, (*batch, 6))
    model = co.niryo_one()
    assert co.clearance(NIRYO, model, q).shape == batch
    found = co.distances(NIRYO, model, q)
    assert found.distance.shape == (*batch, len(model.pairs))
    assert co.collides(NIRYO, model, q).shape == batch


def test_precision_follows_the_joints():
    model = co.niryo_one()
    found = co.clearance(NIRYO, model, Q.astype(np.float32))
    assert found.dtype == np.float32
    assert float(found) == pytest.approx(float(co.clearance(NIRYO, model, Q)), abs=1e-6)


def test_transformations_agree(rng):
    q = rng.uniform(-1, 1, (5, 3))
    plain = co.clearance(SMALL, SMALL_MODEL, q, WORLD)

    def least(q, robot=SMALL, model=SMALL_MODEL, world=WORLD):
        return co.clearance(robot, model, q, world)

    np.testing.assert_allclose(jax.jit(least)(q), plain, atol=1e-14)
    np.testing.assert_allclose(jax.vmap(least)(q), plain, atol=1e-14)
    traced = jax.jit(least)(q, SMALL, SMALL_MODEL, WORLD)
    np.testing.assert_allclose(traced, plain, atol=1e-14)
    held = jax.tree.map(jnp.asarray, SMALL_MODEL)
    np.testing.assert_allclose(jax.jit(lambda q: least(q, model=held))(q), plain, atol=1e-14)

    # A traced model is the same within a function that closes over it, and after.
    def twice(model, q):
        return jax.jit(lambda q: least(q, model=model))(q) + least(q, model=model)

    np.testing.assert_allclose(jax.jit(twice)(SMALL_MODEL, q), 2 * plain, atol=1e-14)
    models = jax.tree.map(lambda x: np.stack([x, x]), SMALL_MODEL)
    of_models = jax.vmap(lambda model: least(q, model=model))(models)
    np.testing.assert_allclose(of_models, np.stack([plain, plain]), atol=1e-14)


def test_nothing_to_look_at_is_infinitely_far():
    model = SMALL_MODEL.allow([(0, 3), (1, 3)])
    assert np.isinf(co.clearance(SMALL, model, SMALL_Q))
    assert co.distances(SMALL, model, SMALL_Q).distance.shape == (0,)
    assert not co.collides(SMALL, model, SMALL_Q)


class TestNiryo:
    @pytest.mark.parametrize("name", SHAPES)
    @pytest.mark.parametrize("tool", [None, "gripper_1", "gripper_3"])
    def test_poses_that_robots_take_are_free(self, name, tool):
        q = [np.zeros(6), AT_REST, [0, 0.6, -1.3, 0, 0, 0], [0, 0, 1.57, 0, 0, 0]]
        for side in (-45, 45):
            q.append(np.deg2rad([side, -29.0303, -38.3463, 0, -22.6234, side]))
            q.append(np.deg2rad([side, -46.8656, -34.8624, 0, -8.2720, side]))
        least = co.clearance(MODELS[name].robot(), SHAPES[name](tool), np.array(q))
        assert np.all(np.asarray(least) > 0.01)

    def test_an_arm_that_folds_into_its_base_collides(self):
        q = [0, -1.9, -1.3, 0, -1.7, 0]
        found = co.distances(NIRYO, co.niryo_one(), q)
        assert bool(co.collides(NIRYO, co.niryo_one(), q))
        assert found.nearest_pair()[0] == "base"

    def test_the_gripper_touches_the_table_where_it_grips(self):
        # 88 mm above the table with a gripper of 85 mm (gripper 1), pointing down.
        q = np.deg2rad([-45, -46.8656, -34.8624, 0, -8.2720, -45])
        model, table = co.niryo_one(0.085), co.World.table(0.0)
        assert float(co.clearance(NIRYO, model, q, table)) == pytest.approx(0.003, abs=1e-5)
        assert bool(co.collides(NIRYO, model, q, co.World.table(0.01)))
        assert bool(co.collides(NIRYO, model, q, table, margin=0.01))

    def test_tools(self):
        assert co.niryo_one("none").names == co.niryo_one().names
        with pytest.raises(ValueError, match="tool: expected one of 'none'"):
            co.niryo_one("drill")
        with pytest.raises(ValueError, match="tool: expected a positive length"):
            co.niryo_ned(-0.1)

    def test_solutions_are_told_that_collide(self):
        model = co.niryo_one()
        poses = nj.forward_kinematics(NIRYO, np.stack([Q, FOLDED]))
        solutions = nj.inverse_kinematics(NIRYO, poses)
        found = co.free(NIRYO, model, solutions)
        least = np.asarray(co.clearance(NIRYO, model, solutions.q))
        slots = np.asarray(solutions.found)
        np.testing.assert_array_equal(found.clear, slots & (least > 0))
        np.testing.assert_array_equal(found.clearance[slots], least[slots])
        assert np.all(np.isneginf(found.clearance[~slots]))
        # The second set is folded into the base in all ways to take the pose.
        none = np.asarray(solutions.complete) & ~np.any(found.clear, -1)
        np.testing.assert_array_equal(found.all_collide, none)
        assert not found.all_collide[0]
        # A wall through the tool: whatever the arm does, it is there.
        wall = co.World.spheres(np.asarray(poses)[:1, :3, 3], [0.05])
        found = co.free(NIRYO, model, solutions, wall)
        np.testing.assert_array_equal(
            found.all_collide, np.asarray(solutions.complete) & ~np.any(found.clear, -1)
        )
        assert bool(found.all_collide[0])
        unproved = dataclasses.replace(solutions, complete=np.array([False, False]))
        assert not np.any(co.free(NIRYO, model, unproved, wall).all_collide)


def test_pruning_leaves_out_what_always_and_what_never_touches():
    model = co.CollisionModel.from_capsules(
        start=np.array([[0, 0, 0.0], [0, 0, 0.2], [0.3, 0, 0.2], [0, 0, 3]]),
        end=np.array([[0, 0, 0.1], [0, 0, 0.2], [0.5, 0, 0.2], [0, 0, 3]]),
        radius=[0.05, 0.2, 0.03, 0.1],
        links=[0, 1, 3, 0],
        names=["foot", "knob", "arm", "lamp"],
        pairs=[("foot", "arm"), ("knob", "arm"), ("lamp", "arm"), ("foot", "knob")],
    )
    found = co.prune(SMALL, model, samples=500)
    assert found.always == (("foot", "knob"),)
    assert found.never == (("arm", "lamp"),)
    assert found.model.pair_names() == (("foot", "arm"), ("knob", "arm"))
    again = co.prune(SMALL, model, samples=500)
    assert again.model.pairs == found.model.pairs


def test_a_skeleton_runs_along_the_axes():
    robot = nj.robots.ur16e()
    model = co.skeleton(robot, 0.05)
    lengths = np.linalg.norm(model.end - model.start, axis=1)
    assert {round(float(x), 4) for x in lengths} >= {0.478, 0.36}
    tool = np.asarray(robot.home)[:3, 3]
    np.testing.assert_allclose(model.end[-1], tool, atol=1e-12)
    # One chain: each capsule starts where the one before it ends.
    np.testing.assert_allclose(model.start[1:], model.end[:-1], atol=1e-12)
    assert np.all(np.isfinite(co.clearance(robot, model, np.zeros(6))))
    # The column along the first axis is the base's, which stands on the table.
    assert model.links[0] == 0
    assert float(co.clearance(robot, model, np.zeros(6), co.World.table())) < 0.02
    assert np.all([pair[1] - pair[0] > 1 for pair in model.pairs])
    slides = nj.robots.load("abb_irb910sc")
    assert np.all(np.isfinite(co.clearance(slides, co.skeleton(slides, 0.02), np.zeros(4))))


URDF = """<robot name="two">
  <link name="base"><collision><geometry><box size="0.2 0.1 0.4"/></geometry></collision></link>
  <link name="arm">
    <collision><origin xyz="0.5 0 0" rpy="0 1.5707963267948966 0"/>
      <geometry><cylinder radius="0.04" length="0.6"/></geometry></collision>
    <collision><origin xyz="1 0 0"/><geometry><sphere radius="0.07"/></geometry></collision>
  </link>
  <link name="hand"><collision><geometry>{hand}</geometry></collision></link>
  <link name="finger"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/><limit lower="-1" upper="1"/></joint>
  <joint name="wrist" type="revolute"><parent link="arm"/><child link="hand"/>
    <origin xyz="1 0 0"/><axis xyz="0 1 0"/><limit lower="-1" upper="1"/></joint>
  <joint name="grip" type="prismatic"><parent link="hand"/><child link="finger"/>
    <origin xyz="0.2 0 0"/><axis xyz="0 1 0"/><limit lower="0" upper="1"/></joint>
</robot>"""


@pytest.mark.usefixtures("_yourdfpy")
class TestUrdf:
    @pytest.fixture
    def _yourdfpy(self):
        pytest.importorskip("yourdfpy")

    def test_primitives(self):
        text = URDF.format(hand='<box size="0.1 0.3 0.1"/>')
        model = co.from_urdf(text, tip="hand")
        assert model.names == ("base", "arm", "arm_2", "hand", "finger")
        assert model.links == (0, 1, 1, 2, 2)
        np.testing.assert_allclose(model.start[1], [0.2, 0, 0.3], atol=1e-12)
        np.testing.assert_allclose(model.end[1], [0.8, 0, 0.3], atol=1e-12)
        np.testing.assert_allclose(model.start[2], model.end[2])
        np.testing.assert_allclose(model.radius[0], np.hypot(0.1, 0.05))
        np.testing.assert_allclose(np.sort(model.start[3:4, 1]), [-0.15])
        np.testing.assert_allclose(model.start[4], [1.2, 0, 0.3])
        robot = nj.robots.from_urdf(text, tip="hand")
        assert co.clearance(robot, model, np.zeros(2)) > 0

    def test_a_mesh_is_enclosed(self, tmp_path, rng):
        trimesh = pytest.importorskip("trimesh")
        mesh = trimesh.creation.cylinder(radius=0.05, height=0.4)
        mesh.apply_transform(random_poses(rng).astype(float))
        (tmp_path / "meshes").mkdir()
        mesh.export(tmp_path / "meshes" / "hand.stl")
        file = tmp_path / "arm.urdf"
        file.write_text(URDF.format(hand='<mesh filename="package://arm/meshes/hand.stl"/>'))
        model = co.from_urdf(file, tip="hand")
        points = np.asarray(mesh.vertices) + np.array([1, 0, 0.3])
        at = np.broadcast_to(points[:, None], (len(points), 1, 3))[:, 0]
        ends = (np.broadcast_to(x[3], at.shape) for x in (model.start, model.end))
        assert np.max(co.segment_distance(at, at, *ends)) <= model.radius[3] + 1e-7
        assert model.radius[3] < 0.07

    @pytest.mark.parametrize(
        ("hand", "word"),
        [
            ('<mesh filename="nowhere.stl"/>', "no mesh file"),
            ('<sphere radius="x"/>', "expected 1 finite numbers"),
            ("<cone/>", "expected one of sphere"),
            ("", "got nothing"),
        ],
    )
    def test_what_cannot_be_read_is_named(self, hand, word):
        with pytest.raises((ValueError, FileNotFoundError), match=word):
            co.from_urdf(URDF.format(hand=hand), tip="hand")


CAPSULES = {"start": np.zeros((2, 3)), "end": np.ones((2, 3)), "radius": 0.1, "links": [0, 2]}


@pytest.mark.parametrize(
    ("changed", "error", "word"),
    [
        ({"start": np.zeros((2, 2))}, ValueError, r"start: expected shape \(2, 3\)"),
        ({"end": np.zeros((3, 3))}, ValueError, r"end: expected shape \(2, 3\)"),
        ({"end": np.full((2, 3), np.nan)}, ValueError, "end: expected finite numbers"),
        ({"start": "abc"}, TypeError, "start: expected an array of numbers"),
        ({"radius": -0.1}, ValueError, "radius: expected 0 or more"),
        ({"links": [0]}, ValueError, "links: expected 2 numbers, got 1"),
        ({"links": [0, -1]}, ValueError, "links: expected 0 or more"),
        ({"links": [0, 1.5]}, TypeError, "links: expected 2 whole numbers"),
        ({"links": []}, TypeError, "links: expected 2 whole numbers"),
        ({"names": ["a", "a"]}, ValueError, "names: expected distinct names, got a twice"),
        ({"names": ["a"]}, ValueError, "names: expected 2 names"),
        ({"pairs": [("a", 2)]}, ValueError, "pairs: expected one of 'link_0', 'link_2', 0, 2"),
        ({"pairs": [3]}, TypeError, "pairs: expected pairs of capsules or links, got 3"),
        ({"pairs": [(0, 0)]}, ValueError, "both of link 0"),
        ({"allowed": [(0, 7)]}, ValueError, "allowed: expected one of"),
    ],
)
def test_models_that_are_none_are_refused(changed, error, word):
    with pytest.raises(error, match=word):
        co.CollisionModel.from_capsules(**{**CAPSULES, **changed})


@pytest.mark.parametrize(
    ("make", "error", "word"),
    [
        (lambda: co.World.table(np.nan), ValueError, "height: expected a finite number"),
        (lambda: co.World.planes([[0, 0, 2]], [0]), ValueError, "plane_normals: expected unit"),
        (lambda: co.World.planes([[0, 0, 1]], [0, 1]), ValueError, "plane_offsets: expected 1"),
        (lambda: co.World.boxes([[0, 0, 1]], [[1, 1]]), ValueError, "box_half_sizes: expected"),
        (lambda: co.World.boxes([[0, 0, 1]], [[1, 1, -1]]), ValueError, "box_half_sizes: expec"),
        (lambda: co.World.boxes(2 * np.eye(4)[None], [[1, 1, 1]]), ValueError, "box_poses"),
        (lambda: co.World.spheres([[0, 0, 1]], [-1]), ValueError, "sphere_radii: expected 0"),
        (lambda: co.World.spheres([0, 0, 1], [1]), ValueError, "sphere_centres: expected shape"),
        (lambda: co.World.capsules([[0, 0, 1]], [[0, 0]], [1]), ValueError, "capsule_ends"),
        (lambda: co.World.table(ignored="base"), TypeError, "ignored: expected numbers of links"),
        (lambda: co.World.table(name=3), TypeError, "names: expected a text"),
        (lambda: co.clearance(SMALL, SMALL_MODEL, np.zeros(2)), ValueError, "q: expected shape"),
        (lambda: co.clearance(SMALL, co.niryo_one(), SMALL_Q), ValueError, "model: expected links"),
        (lambda: co.clearance(SMALL, None, SMALL_Q), TypeError, "model: expected a Collision"),
        (lambda: co.clearance(SMALL, SMALL_MODEL, SMALL_Q, "x"), TypeError, "world: expected"),
        (lambda: co.collides(SMALL, SMALL_MODEL, SMALL_Q, margin=np.inf), ValueError, "margin"),
        (lambda: co.free(SMALL, SMALL_MODEL, None), TypeError, "solutions: expected IKSol"),
        (lambda: co.skeleton(SMALL, 0.0), ValueError, "radius: expected a positive length"),
        (lambda: co.prune(SMALL, SMALL_MODEL, samples=0), ValueError, "samples: expected 1"),
    ],
)
def test_what_is_none_is_named(make, error, word):
    with pytest.raises(error, match=word):
        make()


def test_more_capsules_can_be_attached():
    model = SMALL_MODEL.attach([[0.5, 0, 0.2]], [[0.6, 0, 0.2]], [0.02], [3], names=["load"])
    assert model.names[-1] == "load"
    new = [pair for pair in model.pair_names() if "load" in pair]
    assert new == [("link_0", "load"), ("link_1", "load")]
    assert model.pairs[: len(SMALL_MODEL.pairs)] == SMALL_MODEL.pairs
    assert SMALL_MODEL.attach([[0, 0, 1]], [[0, 0, 1]], [0.1], [3]).names[-1] == "link_3_3"
