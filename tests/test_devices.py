"""Several devices, several cores, and programs that are exported: the answers stay the same."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import niryo_jax as nj
from niryo_jax.execution import devices as parallel
from niryo_jax.execution.padding import program_size
from niryo_jax.ik.results.deduplicate import distinct
from niryo_jax.ik.results.solutions import map_solutions

ON_EIGHT_DEVICES = """
    import jax
    jax.config.update("jax_num_cpu_devices", 8)
    jax.config.update("jax_enable_x64", True)
    import numpy as np
    from jax.sharding import Mesh, NamedSharding, PartitionSpec
    import niryo_jax as nj
    from niryo_jax.execution import devices as parallel

    robot = nj.robots.niryo_one()
    rows = NamedSharding(Mesh(np.array(jax.devices()), ("rows",)), PartitionSpec("rows"))
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (64, 6))
    spread = jax.device_put(q, rows)
    pose = nj.forward_kinematics(robot, q)
    spread_pose = nj.forward_kinematics(robot, spread)
    pairs = [
        (pose, spread_pose),
        (nj.space_jacobian(robot, q), nj.space_jacobian(robot, spread)),
        (nj.se3.log(pose), nj.se3.log(spread_pose)),
    ]
    poses = jax.device_put(pose, rows)
    for solve in (
        lambda pose, q: nj.inverse_kinematics(robot, pose),
        lambda pose, q: nj.newton_raphson(robot, pose, q + 0.05),
    ):
        pairs += zip(jax.tree.leaves(solve(pose, q)), jax.tree.leaves(solve(poses, spread)))
    last = jax.devices()[-1]
    parallel._LEAST, parallel.cores = 100, lambda: 2
    def double(x):
        return 2.0 * x
    with jax.default_device(last):
        far = parallel.on_all_cores(double, [jax.numpy.ones(400)], (400,), lambda size: size)
    assert far.devices() == {last} and not far.committed
    near = jax.device_put(np.ones(400), last)
    far = parallel.on_all_cores(double, [near], (400,), lambda size: size)
    assert far.devices() == {last} and far.committed
    for one, many in pairs:
        one, where = np.asarray(one), many.sharding
        if len(one) == 64:
            assert len(where.device_set) == 8 and not where.is_fully_replicated, where
        # Programs of other sizes add in other orders.
        np.testing.assert_allclose(one, np.asarray(many), rtol=0, atol=1e-11)
    print("the same", len(pairs))
"""


def test_eight_devices_answer_as_one():
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(ON_EIGHT_DEVICES)],
        env={**os.environ, "JAX_PLATFORMS": "cpu"},
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("the same")


@pytest.fixture
def three_cores(monkeypatch):
    """As if the process had three cores, and were ready to use them for a few poses."""
    monkeypatch.setattr(parallel, "cores", lambda: 3)
    monkeypatch.setattr(parallel, "_LEAST", 100)


@pytest.mark.usefixtures("three_cores")
@pytest.mark.parametrize("batch", [(300,), (1000,), (2, 260), (199,)])
def test_pieces_make_up_the_whole(batch):
    x = np.random.default_rng(0).standard_normal((*batch, 2))
    sizes = []

    def solve(x):
        sizes.append(x.shape[:-1])
        return {"square": x * x, "sum": jnp.sum(x, axis=-1)}

    found = parallel.on_all_cores(solve, [jnp.asarray(x)], batch, program_size)
    np.testing.assert_array_equal(found["square"], x * x)
    np.testing.assert_array_equal(found["sum"], np.sum(x, axis=-1))
    assert len(set(sizes)) == 1, "all pieces share one program"


@pytest.mark.usefixtures("three_cores")
def test_an_error_in_a_piece_is_raised():
    def solve(x):
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        parallel.on_all_cores(solve, [jnp.zeros((999, 2))], (999,), program_size)


@pytest.mark.usefixtures("three_cores")
def test_a_precision_chosen_for_a_block_of_code_holds_in_every_piece():
    single = jnp.zeros((999, 2), jnp.float32)
    with jax.enable_x64(False):
        found = parallel.on_all_cores(lambda x: x + jnp.ones(2), [single], (999,), program_size)
    assert found.dtype == jnp.float32


@pytest.mark.usefixtures("three_cores")
def test_inverse_kinematics_on_all_cores_is_that_on_one(niryo, monkeypatch):
    q = np.random.default_rng(1).uniform(niryo.lower, niryo.upper, (2, 200, 6))
    pose = nj.forward_kinematics(niryo, q)
    many = nj.inverse_kinematics(niryo, pose)
    monkeypatch.setattr(parallel, "cores", lambda: 1)
    parts = [nj.inverse_kinematics(niryo, x) for x in pose.reshape(2, 200, 4, 4)]
    one = map_solutions(lambda *x: jnp.stack(x), *parts)
    for a, b in zip(jax.tree.leaves(many), jax.tree.leaves(one)):
        np.testing.assert_array_equal(a, b)


def test_exported_programs_answer_as_the_functions_do(niryo):
    pytest.importorskip("flatbuffers")
    q = np.random.default_rng(2).uniform(niryo.lower, niryo.upper, (16, 6))
    pose = nj.forward_kinematics(niryo, q)

    def round_trip(function, argument):
        exported = jax.export.export(jax.jit(function))(jax.typeof(argument))
        return jax.export.deserialize(exported.serialize()).call(argument)

    forward = round_trip(lambda q: nj.forward_kinematics(niryo, q), jnp.asarray(q))
    np.testing.assert_allclose(forward, pose, rtol=0, atol=1e-14)
    solved = round_trip(lambda pose: nj.inverse_kinematics(niryo, pose), pose)
    assert isinstance(solved, nj.IKSolutions)
    direct = nj.inverse_kinematics(niryo, pose)
    np.testing.assert_array_equal(solved.found, direct.found)
    np.testing.assert_allclose(solved.q, direct.q, rtol=0, atol=1e-9)
    assert solved.periodic == direct.periodic


def test_the_different_joint_vectors_of_very_many_poses():
    # More than fit, owner and number together, in the bits of one integer.
    rows, each = 100_000, 4
    rng = np.random.default_rng(8)
    q = rng.uniform(-3, 3, (rows, each, 6))
    q[:, 3] = q[:, 1] + 2 * np.pi
    owner = np.repeat(np.arange(rows), each)
    order = rng.permutation(rows * each)
    vectors, owner = jnp.asarray(q.reshape(-1, 6)[order]), jnp.asarray(owner[order])
    table, crowded = jax.jit(distinct, static_argnums=(2, 3))(vectors, owner, rows, 8)
    assert not np.any(crowded)
    table = np.asarray(table)
    np.testing.assert_array_equal(np.sum(table >= 0, axis=0), 3)
    pose, number = np.divmod(order[table], each)
    number = np.where(number == 3, 1, number)
    chosen = np.sort(np.where(table >= 0, 3 * pose + number, -1), axis=0)
    np.testing.assert_array_equal(chosen[-3:], np.arange(3 * rows).reshape(rows, 3).T)


@pytest.mark.parametrize("name", ["niryo_one", "ur16e"])
def test_programs_of_the_sizes_for_an_accelerator_give_the_same_answers(name, monkeypatch):
    robot = nj.robots.load(name)
    rng = np.random.default_rng(9)
    pose = nj.forward_kinematics(robot, rng.uniform(robot.lower, robot.upper, (2048, 6)))
    here = nj.inverse_kinematics(robot, pose)
    jax.clear_caches()
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    there = nj.inverse_kinematics(robot, pose)
    jax.clear_caches()
    np.testing.assert_array_equal(here.count, there.count)
    np.testing.assert_array_equal(here.status, there.status)
    np.testing.assert_allclose(there.q, here.q, atol=1e-9)
