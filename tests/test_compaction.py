"""A choice of rows, worked on so many at a time: against plain indexing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from niryo_jax.execution.compaction import append, for_each_chunk, running_count, tally

append = jax.jit(append)
NEW = 8


@given(st.lists(st.booleans(), min_size=NEW, max_size=NEW), st.integers(0, 12))
def test_chosen_rows_are_appended_in_their_order(which, count):
    rows = np.arange(40.0).reshape(20, 2)
    new = 100.0 + np.arange(2.0 * NEW).reshape(NEW, 2)
    appended, total = append(rows, jnp.int32(count), new, np.array(which))
    assert int(total) == count + sum(which)
    expected = np.concatenate([rows[:count], new[np.array(which)]])
    np.testing.assert_array_equal(appended[: int(total)], expected)
    # Behind what is written, as many rows as there are new ones, all is as it was.
    np.testing.assert_array_equal(appended[count + NEW :], rows[count + NEW :])


@pytest.mark.parametrize("count", [13, 16, 20, 30])
def test_without_room_the_count_tells_and_what_fits_in_front_of_it_stays(count):
    rows = np.arange(40.0).reshape(20, 2)
    new = np.full((NEW, 2), -1.0)
    appended, total = append(rows, jnp.int32(count), new, np.ones(NEW, bool))
    assert int(total) == count + NEW > len(rows)
    np.testing.assert_array_equal(appended[: 20 - NEW], rows[: 20 - NEW])


def test_of_more_new_rows_than_there_is_room_the_first_are_kept():
    new = np.arange(10.0)[:, None]
    appended, total = append(np.zeros((4, 1)), jnp.int32(0), new, new[:, 0] >= 3)
    assert int(total) == 7
    np.testing.assert_array_equal(appended[:, 0], [3, 4, 5, 6])


@pytest.mark.parametrize("size", [1, 63, 64, 65, 1000])
@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
def test_running_counts(size, share, rng):
    which = rng.random(size) < share
    count, total = running_count(jnp.asarray(which))
    np.testing.assert_array_equal(count, np.cumsum(which))
    assert int(total) == which.sum()


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_each_chosen_row_is_worked_on_once(share, rng):
    which = rng.random(37) < share

    def body(state, rows, live):
        return state.at[jnp.where(live, rows, len(state))].add(1, mode="drop")

    times = for_each_chunk(jnp.asarray(which), 5, body, jnp.zeros(37, int))
    np.testing.assert_array_equal(times, which)


def test_tallies():
    counts = tally(jnp.array([5, 0, 0]), jnp.array([0, 2, 2, 7]), jnp.array([True] * 4))
    np.testing.assert_array_equal(counts, [6, 0, 2])
