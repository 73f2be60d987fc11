"""Programs that are exported for batches of any size."""

from __future__ import annotations

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest

import niryo_jax as nj

SCARA = nj.robots.abb_irb910sc()


@pytest.mark.parametrize(
    ("function", "sizes"),
    [
        (lambda q, _: nj.forward_kinematics(SCARA, q), (1, 3)),
        (lambda q, pose: nj.newton_raphson(SCARA, pose, q + 0.01), (1, 3)),
        (lambda _, pose: nj.inverse_kinematics(SCARA, pose), (1, 3)),
        (lambda _, pose: nj.inverse_kinematics(SCARA, pose[:, None]), (3,)),
    ],
    ids=["forward kinematics", "Newton-Raphson", "inverse kinematics", "two batch axes"],
)
def test_a_batch_of_any_size_has_the_answers_of_a_known_one(function, sizes, rng):
    (b,) = jax.export.symbolic_shape("b")
    arrays = [jax.ShapeDtypeStruct((b, 4), float), jax.ShapeDtypeStruct((b, 4, 4), float)]
    exported = jax.export.export(jax.jit(function))(*arrays)
    for size in sizes:
        q = rng.uniform([-1, -1, -0.1, -1], [1, 1, 0, 1], (size, 4))
        pose = nj.forward_kinematics(SCARA, q)
        answer, known = exported.call(jnp.asarray(q), pose), function(jnp.asarray(q), pose)
        assert jax.tree.structure(answer) == jax.tree.structure(known)
        for x, y in zip(jax.tree.leaves(answer), jax.tree.leaves(known)):
            assert x.shape == y.shape
            np.testing.assert_allclose(x, y, atol=1e-9)
