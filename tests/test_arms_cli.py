"""The commands `niryo-jax robots` and `describe`."""

from __future__ import annotations

import importlib.util
import re
import sys

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("rich")

import niryo_jax as nj

needs_yourdfpy = pytest.mark.skipif(
    importlib.util.find_spec("yourdfpy") is None, reason="yourdfpy is not installed"
)


# --- robots


def test_every_robot_is_listed(cli, as_json):
    code, document = as_json("robots")
    assert code == 0
    listed = {arm["name"]: arm for arm in document["robots"]}
    assert tuple(listed) == nj.robots.names()
    for name, arm in listed.items():
        robot = nj.robots.load(name)
        assert arm["joints"] == robot.joints == len(arm["kinds"])
        slides = np.all(np.asarray(robot.screws)[:, :3] == 0, axis=1)
        assert [kind == "P" for kind in arm["kinds"]] == list(slides)
        assert any("inverse kinematics" in line for line in arm["structure"])
        for line in arm["structure"]:
            assert line in robot.describe()
    code, out, _ = cli("robots")
    assert code == 0
    for name in listed:
        assert re.search(rf"^ *{name} .* {listed[name]['kinds']} ", out, re.MULTILINE)


# --- describe


def test_describe_shows_what_the_robot_says_of_itself(cli):
    expected = nj.robots.niryo_one().describe()
    for arguments in ((), ("niryo_one",), ("--robot", "niryo_one")):
        assert cli("describe", *arguments) == (0, f"{expected}\n", "")


@pytest.mark.parametrize("name", ["niryo_ned2", "abb_irb910sc"])
def test_describe_takes_every_name(as_json, name):
    robot = nj.robots.load(name)
    code, document = as_json("describe", name)
    assert code == 0
    assert as_json("describe", "--robot", name) == (0, document)
    assert document["robot"] == robot.name
    assert document["joint_names"] == list(robot.joint_names)
    assert document["description"] == robot.describe()
    np.testing.assert_array_equal(document["screws"], robot.screws)
    np.testing.assert_array_equal(document["home"], robot.home)
    np.testing.assert_array_equal(document["lower_rad"], robot.lower)
    np.testing.assert_array_equal(document["upper_rad"], robot.upper)


ARM = """<robot name="arm"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
<joint name="j1" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
<joint name="j2" type="prismatic"><parent link="b"/><child link="c"/>
<limit lower="-1" upper="2"/></joint>
<joint name="j3" type="fixed"><parent link="b"/><child link="d"/></joint></robot>"""


@pytest.fixture
def urdf(tmp_path):
    """A URDF file of two leaves."""
    file = tmp_path / "arm.urdf"
    file.write_text(ARM)
    return file


@needs_yourdfpy
def test_describe_reads_a_urdf_file(as_json, cli, urdf):
    code, document = as_json("describe", urdf, "--tip", "c")
    assert code == 0
    assert (document["robot"], document["joint_names"]) == ("arm", ["j1", "j2"])
    assert document["joint_kinds"] == ["revolute", "prismatic"]
    # JSON has no infinity.
    assert (document["lower_rad"], document["upper_rad"]) == ([None, -1], [None, 2])
    code, document = as_json("describe", urdf, "--base", "b", "--tip", "c")
    assert document["joint_names"] == ["j2"]
    code, out, _ = cli("describe", urdf, "--tip", "c")
    assert code == 0
    assert out.startswith("arm: 2 joints\n  j1: revolute, along (0, 0, 1)")


@needs_yourdfpy
@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ([], "several chains start at link 'a'; choose one of 'c', 'd'"),
        (["--tip", "x"], "tip: no link is named 'x'"),
        (["--tip", "d", "--base", "b"], "no joint moves between links 'b' and 'd'"),
    ],
)
def test_a_urdf_file_that_does_not_do_ends_with_2(cli, as_json, urdf, options, sentence):
    code, out, err = cli("describe", urdf, *options)
    assert (code, out) == (2, "")
    assert sentence in err
    code, document = as_json("describe", urdf, *options)
    assert code == document["exit_code"] == 2
    assert sentence in document["error"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["absent.urdf"],
            "'absent.urdf' is neither a URDF or MJCF file nor one of the robots",
        ),
        (["--robot", "absent"], "'absent' is neither"),
        (["niryo_one", "--robot", "niryo_ned"], "name the robot once"),
        (
            ["niryo_one", "--tip", "hand"],
            "--base and --tip choose the chain of a URDF or MJCF",
        ),
        (["niryo_one", "niryo_ned"], "niryo_ned"),
    ],
)
def test_wrong_arguments_end_with_2_and_one_sentence(cli, arguments, sentence):
    code, out, err = cli("describe", *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert sentence in err


def test_a_missing_parser_ends_with_5(cli, urdf, monkeypatch):
    monkeypatch.setitem(sys.modules, "yourdfpy", None)
    code, out, err = cli("describe", urdf)
    assert (code, out) == (5, "")
    assert 'pip install "niryo_jax[urdf]"' in err


# --- arms of files, in every command


needs_mujoco = pytest.mark.skipif(
    importlib.util.find_spec("mujoco") is None, reason="mujoco is not installed"
)
SCARA = """<mujoco model="scara"><worldbody><body name="a"><joint name="j1" axis="0 0 1"/>
<geom size=".1"/><body name="b" pos=".3 0 0"><joint name="j2" axis="0 0 1"/><geom size=".1"/>
<body name="c" pos=".2 0 0"><joint name="j3" axis="0 0 1"/><geom size=".1"/>
<body name="d" pos="0 0 .1"><joint name="j4" type="slide" axis="0 0 1" range="-1 2"/>
<geom size=".1"/><site name="hand" pos="0 .1 0"/></body></body></body></body></worldbody></mujoco>
"""


@pytest.fixture
def mjcf(tmp_path):
    """An MJCF file of four joints and a site."""
    file = tmp_path / "scara.xml"
    file.write_text(SCARA)
    return file


@needs_mujoco
def test_an_mjcf_arm_is_described_and_solved(as_json, mjcf, monkeypatch):
    code, document = as_json("describe", mjcf, "--tip", "hand")
    assert code == 0
    assert document["robot"] == "scara"
    assert document["joint_kinds"] == ["revolute"] * 3 + ["prismatic"]
    with mjcf.open() as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        assert as_json("describe", "-", "--tip", "hand") == (0, document)
    other = mjcf.rename(mjcf.with_suffix(".model"))
    assert as_json("describe", other, "--tip", "hand") == (0, document)
    arm = ("--robot", other, "--tip", "hand")
    # The last joint slides, and is in metres whatever the unit of the angles.
    code, reached = as_json("fk", 10, 20, 30, 0.5, "--degrees", *arm)
    assert code == 0
    np.testing.assert_allclose(reached["joints_rad"], [*np.deg2rad([10, 20, 30]), 0.5])
    np.testing.assert_allclose(reached["pose"][2][3], 0.6)
    code, document = as_json("ik", "--matrix", str(reached["pose"]), "--degrees", *arm)
    assert (code, document["robot"]) == (0, "scara")
    joints = np.array([solution["joints_rad"] for solution in document["solutions"]])
    assert np.abs(joints - reached["joints_rad"]).max(axis=1).min() < 1e-9


@needs_yourdfpy
def test_a_urdf_arm_is_the_arm_that_it_was_written_from(as_json, tmp_path):
    file = tmp_path / "arm.urdf"
    robot = nj.robots.niryo_one()
    nj.robots.to_urdf(robot, file)
    q = [str(angle) for angle in (0.1, -0.2, 0.3, 0.4, -0.5, 0.6)]
    _, expected = as_json("fk", *q, "--radians")
    code, document = as_json("fk", *q, "--radians", "--robot", file)
    assert (code, document["within_limits"]) == (0, True)
    np.testing.assert_allclose(document["pose"], expected["pose"], rtol=0, atol=1e-12)
    code, found = as_json("ik", "--matrix", str(expected["pose"]), "--radians", "--robot", file)
    assert (code, found["complete"]) == (0, True)
    joints = np.array([solution["joints_rad"] for solution in found["solutions"]])
    assert np.abs(joints - expected["joints_rad"]).max(axis=1).min() < 1e-9
    code, planned = as_json("pick-and-place", "--dry-run", "--robot", file)
    assert (code, len(planned["steps"])) == (0, 10)
    code, refused = as_json("pick-and-place", "--robot", file)
    assert code == refused["exit_code"] == 2
    assert "is no Niryo arm" in refused["error"]


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (bytes(range(256)), "expected a URDF or MJCF document; this is no XML"),
        (b"", "this is no XML: no element found"),
        (b"hello", "this is no XML: syntax error"),
        (b"<html/>", "expected a URDF (<robot>) or an MJCF model (<mujoco>), got <html>"),
        (b"<robot name='a'><link", "unclosed token"),
        (b"<robot name='a'><link name='a'/></robot>", "no joint moves"),
        (b"<mujoco/>", "expected one chain"),
        (b"<mujoco><worldbody><body><joint type='x'/></body></worldbody></mujoco>", "'x'"),
    ],
)
@pytest.mark.parametrize("command", ["describe", "fk", "ik", "map"])
def test_a_file_that_is_no_arm_ends_with_2_and_its_name(cli, tmp_path, content, sentence, command):
    pytest.importorskip("mujoco" if b"mujoco" in content else "yourdfpy")
    file = tmp_path / "arm.xml"
    file.write_bytes(content)
    arguments = {
        "describe": ["describe", file],
        "fk": ["fk", "0", "--degrees", "--robot", file],
        "ik": ["ik", *"000", "--rpy", *"000", "--degrees", "--robot", file],
        "map": ["workspace", "map", file, "--dry-run"],
    }[command]
    code, out, err = cli(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith(f"error: ROBOT: {file}: ")
    assert sentence in err
    assert len(err.splitlines()) == 1


def test_a_missing_reader_of_mjcf_ends_with_5(cli, mjcf, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    code, out, err = cli("describe", mjcf)
    assert (code, out) == (5, "")
    assert 'pip install "niryo_jax[mjcf]"' in err
