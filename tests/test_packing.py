"""Columns and arrays: values, and every derivative and transformation of both directions."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import Mesh, PartitionSpec
from jax.test_util import check_grads

import niryo_jax as nj
from niryo_jax.lanes.packing import pack_columns, unpack_columns

SHAPES = [(1,), (6,), (1, 4), (3, 2), (4, 4)]
BATCHES = [(), (1,), (3, 2), (0,)]


def columns_of(rng, shape, batch, dtype=np.float64):
    return [jnp.asarray(rng.standard_normal(batch), dtype) for _ in range(int(np.prod(shape)))]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("compiled", [False, True])
def test_columns_land_in_their_places(rng, shape, compiled):
    cases = [(batch, np.float64) for batch in BATCHES] + [((3, 2), np.float32)]
    many = [columns_of(rng, shape, *case) for case in cases]

    def pack(many):
        return [pack_columns(columns, shape) for columns in many]

    def unpack(many):
        return [unpack_columns(x) for x in many]

    if compiled:
        # One program for all of them.
        pack, unpack = jax.jit(pack), jax.jit(unpack)
    for columns, packed, (batch, dtype) in zip(many, pack(many), cases, strict=True):
        expected = np.stack([np.asarray(x) for x in columns], axis=-1).reshape(*batch, *shape)
        np.testing.assert_array_equal(packed, expected)
        assert packed.dtype == dtype
    rows = [jnp.asarray(np.stack(columns, axis=-1)) for columns in many]
    for columns, apart in zip(many, unpack(rows), strict=True):
        np.testing.assert_array_equal(apart, columns)


@pytest.mark.parametrize("shape", SHAPES)
def test_derivatives_of_every_order_and_mode(rng, shape):
    columns = columns_of(rng, shape, (2,))

    def product(columns):
        packed = jnp.sin(pack_columns(columns, shape)).reshape(2, -1)
        return sum(i * jnp.prod(x) for i, x in enumerate(unpack_columns(packed), 1))

    check_grads(product, (columns,), order=2, modes=["fwd", "rev"])


def test_a_transpose_of_a_transpose_is_the_operation(rng):
    columns = columns_of(rng, (3, 2), (5,))

    def pack(*columns):
        return pack_columns(columns, (3, 2))

    back = jax.linear_transpose(pack, *columns)
    again = jax.linear_transpose(lambda x: back(x), pack(*columns))
    np.testing.assert_array_equal(again(tuple(columns))[0], pack(*columns))


def test_what_is_not_used_and_what_is_constant_have_no_rate(rng):
    columns = columns_of(rng, (3,), (4,))
    used = jax.grad(lambda x: unpack_columns(pack_columns([*columns[:2], x], (3,)))[2].sum())
    np.testing.assert_array_equal(used(columns[2]), np.ones(4))
    unused = jax.grad(lambda x: unpack_columns(pack_columns([*columns[:2], x], (3,)))[0].sum())
    np.testing.assert_array_equal(unused(columns[2]), np.zeros(4))


@pytest.mark.parametrize("axis", [0, 1])
def test_a_batch_on_any_axis_and_columns_without_one(rng, axis):
    one, many = jnp.asarray(rng.standard_normal(3)), jnp.asarray(rng.standard_normal((3, 3)))

    def pack(a, b):
        return pack_columns([a, b], (2,))

    packed = jax.vmap(pack, in_axes=(None, axis))(one, many)
    for i in range(3):
        np.testing.assert_array_equal(packed[i], pack(one, jnp.take(many, i, axis)))
    rows = jnp.asarray(rng.standard_normal((3, 3, 4)))
    apart = jax.vmap(unpack_columns, in_axes=axis)(rows)
    np.testing.assert_array_equal(apart[1], jnp.moveaxis(rows, axis, 0)[..., 1])


def test_shard_map_knows_along_which_axes_a_result_varies(niryo):
    mesh = Mesh(np.array(jax.devices()[:1]), ("rows",))
    rows = PartitionSpec("rows")
    q = np.random.default_rng(0).uniform(-1, 1, (4, 6))

    def height(q):
        return nj.forward_kinematics(niryo, q)[..., 2, 3].sum()

    for function in (lambda q: nj.forward_kinematics(niryo, q), jax.grad(height)):
        spread = jax.jit(jax.shard_map(function, mesh=mesh, in_specs=rows, out_specs=rows))
        np.testing.assert_allclose(spread(q), function(q), rtol=0, atol=1e-14)


@pytest.mark.parametrize("batch", [(), (5,), (3, 2), (0,)])
@pytest.mark.parametrize("function", [nj.forward_kinematics, nj.space_jacobian, nj.body_jacobian])
def test_batch_axes_may_come_last(niryo, function, batch):
    q = np.random.default_rng(3).uniform(-1, 1, (*batch, 6))
    first = np.asarray(function(niryo, q))
    last = np.asarray(function(niryo, np.moveaxis(q, -1, 0), batch_last=True))
    assert last.shape == first.shape[len(batch) :] + batch
    moved = np.moveaxis(last, (0, 1), (-2, -1))
    np.testing.assert_allclose(moved, first, rtol=0, atol=1e-14)
    with pytest.raises(ValueError, match=r"q: expected shape \(6, ...\), got \(5,"):
        function(niryo, np.zeros((5, 2)), batch_last=True)
