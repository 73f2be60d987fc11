"""The table of real arms: what judges the answers is right, and a wrong answer fails the run."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

import niryo_jax as nj
from benchmarks import arms_page, arms_peers, honesty, real_arms, reference, singular
from benchmarks.measure import header
from benchmarks.search import search

FEW = dataclasses.replace(real_arms.QUICK, poses=(16, 4), peers=(8, 4), searched=2, starts=40)
PEERS = tuple(arms_peers.PEERS)


@pytest.fixture(scope="module")
def arms():
    return real_arms.arms()


def test_the_data_are_arms(arms):
    described = json.loads(honesty.REAL_ARMS.read_text())
    assert len(arms) == len(described["arms"]) >= 66
    assert {arm["source"] for arm in described["arms"].values()} == set(described["sources"])
    for robot in arms.values():
        axes = np.asarray(robot.screws)[:, :3]
        axes = axes[np.any(axes, axis=1)]  # one torso slides
        np.testing.assert_allclose(np.linalg.norm(axes, axis=1), 1, atol=1e-12)
        assert np.all(np.asarray(robot.lower) < np.asarray(robot.upper))
        assert all(real_arms.kind(robot))


@pytest.mark.parametrize("name", ["irb120_ik", "yam_ik", "so100", "iiwa14_ik"])
@pytest.mark.parametrize("size", [1e-3, 1e-9])
def test_postures_are_as_near_to_singular_ones_as_they_say(arms, name, size):
    robot = arms[name]
    q = singular.near(robot, size, 8, seed=0)
    assert q.shape == (8, robot.joints)
    low, high = singular.limits(robot)
    assert np.all((q >= low) & (q <= high))
    values = np.linalg.svd(np.asarray(nj.space_jacobian(robot, q)), compute_uv=False)[:, -1]
    np.testing.assert_allclose(values, size, rtol=0.1)


def test_the_search_finds_what_a_closed_form_finds(arms):
    robot = arms["ur5e_ik"]
    q = np.random.default_rng(0).uniform(-3, 3, (3, 6))
    pose = reference.forward_kinematics(robot, q)
    known = search(robot, pose, 200, seed=1)
    answer = nj.inverse_kinematics(robot, pose)
    assert [len(x) for x in known] == list(np.asarray(answer.count))
    for target, solutions in zip(pose, known):
        reached = reference.forward_kinematics(robot, solutions)
        assert np.abs(reached - target).max() < 1e-9


@pytest.mark.parametrize("name", ["irb120_ik", "ur5e_ik", "piper_ik", "yam_ik", "romeo_leg"])
def test_denavit_hartenberg_parameters_describe_the_arm(arms, name):
    robot = arms[name]
    base, (a, alpha, d, theta), tool = arms_peers.denavit_hartenberg(robot)
    table = np.stack([a, alpha, d, theta], axis=1)
    same = nj.robots.from_dh(table, base=base, tool=tool)
    q = np.random.default_rng(0).uniform(-3, 3, (5, 6))
    np.testing.assert_allclose(
        nj.forward_kinematics(same, q), nj.forward_kinematics(robot, q), atol=1e-9
    )


def test_the_table_without_other_libraries(arms, tmp_path, monkeypatch):
    monkeypatch.setattr(arms_page, "RESULTS", tmp_path)
    monkeypatch.setattr(arms_page, "PAGE", tmp_path / "arms.md")
    names = ["irb120_ik", "so100"]
    report = real_arms.measure({name: arms[name] for name in names}, FEW, PEERS)
    assert not report.wrong
    for name in names:
        sets = report.data["arms"][name]["sets"]
        assert sets["random"]["made-by"] == sets["random"]["poses"] == 16
    data = {**report.data, "wrong": ["a sentence"]}
    (tmp_path / f"2026-01-01-{arms_page.STEM}.json").write_text(json.dumps(data))
    arms_page.collect()
    page = (tmp_path / "arms.md").read_text()
    assert "- WRONG: a sentence" in page
    assert page.count("| irb120_ik |") == 1
    assert header(report.data["about"]) in page
    assert "No other library was installed." in page


def test_the_command_without_other_libraries(capsys):
    assert real_arms.table_of(["so100"], ("peers",), quick=True, save=False) == 0
    assert "every answer of ours: right" in capsys.readouterr().out


def test_another_library_is_judged_as_ours(arms, monkeypatch):
    """One that has one solution of a pose at random and is wrong in another."""
    robot = arms["irb120_ik"]

    def one(pose):
        answer = nj.inverse_kinematics(robot, pose)
        q = np.asarray(answer.q)[np.asarray(answer.found)]
        return np.stack([q[0], q[0] + 0.1])

    monkeypatch.setattr(arms_peers, "version_of", lambda _: "1.0")
    monkeypatch.setattr(
        arms_peers,
        "PEERS",
        {"other": ("other", lambda _: arms_peers.Peer("other", one, lambda q: q))},
    )
    report = real_arms.measure({"irb120_ik": robot}, FEW, ())
    judged = report.data["arms"]["irb120_ik"]["peers"]["other"]
    poses = sum(s["poses"] for s in judged["sets"].values())
    assert judged["claimed"] == 2 * poses
    assert judged["spurious"] == poses
    assert all(s["found"] == s["poses"] for s in judged["sets"].values())
    assert judged["recall"] == pytest.approx(1 / 8, abs=0.05)
    assert not report.wrong, "another library's mistakes are not ours"


def test_another_library_may_answer_an_arm_with_joints_to_spare(arms):
    """Of curves of solutions any will do; none is compared with others."""
    robot = arms["mj_tidybot_gen3"]
    q = np.zeros((2, 7))
    solver = arms_peers.Peer("other", lambda pose: np.zeros((1, 7)), lambda answer: answer)
    judged = real_arms.of_a_peer(robot, solver, {"random": q})
    assert judged["sets"]["random"] == {"poses": 2, "made-by": 2, "found": 2}
    assert judged["spurious"] == 0
    assert not judged["solutions"]


@pytest.mark.parametrize("what", ["spurious", "falsely complete", "unreachable"])
def test_what_is_false_fails_the_table(arms, monkeypatch, what):
    solve = nj.inverse_kinematics

    def false(*arguments):
        answer = solve(*arguments)
        if what == "spurious":
            return dataclasses.replace(answer, q=answer.q + 1e-6)
        if what == "unreachable":
            status = answer.status * 0 + nj.IKStatus.UNREACHABLE
            return dataclasses.replace(answer, status=status)
        return dataclasses.replace(answer, found=answer.found & False)

    monkeypatch.setattr(real_arms.nj, "inverse_kinematics", false)
    report = real_arms.measure({"irb120_ik": arms["irb120_ik"]}, FEW, PEERS)
    assert any(what in sentence for sentence in report.wrong)
    assert report.finish(None) == 1
