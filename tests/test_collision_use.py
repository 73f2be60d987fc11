"""Collisions where they are used: complete sets, the command, maps, and plans."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
import pytest
from support import BATCHES

import niryo_jax as nj
from niryo_jax import collision as co
from niryo_jax.collision import FreeStatus

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
