"""URDF in and out: against a plain walk over the XML and the parser's own poses; every mistake."""

from __future__ import annotations

import dataclasses
import io
import math
import re
import sys
from typing import Any, NamedTuple
from xml.etree import ElementTree

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("yourdfpy")

import yourdfpy
from support import (
    DATA,
    LD,
    expm,
    hat3,
    product_of_exponentials,
    random_robot,
    rigid,
    rigid_inverse,
    unit_vectors,
)

import niryo_jax as nj
from niryo_jax.robots.urdf import from_urdf, to_urdf
from niryo_jax.structure import axes

EXACT = 1e-12
INF = math.inf


def walk(xml: str, tip: str, q: dict[str, float]) -> np.ndarray:
    """The pose of a link in the root's frame, from the tip upwards, in extended precision."""
    joints = ElementTree.fromstring(xml).findall("joint")
    above = {joint.find("child").get("link"): joint for joint in joints}
    pose = np.eye(4, dtype=LD)
    while tip in above:
        joint = above[tip]
        value = LD(q.get(joint.get("name"), 0.0))
        axis = vector(joint, "axis", "xyz", (1, 0, 0))
        length = np.sqrt(np.sum(axis * axis))
        axis = axis / length if length > 0 else axis
        slides = joint.get("type") == "prismatic"
        turn = expm(hat3(axis * (0 if slides else value)))
        shift = axis * (value if slides else 0)
        roll, pitch, yaw = vector(joint, "origin", "rpy", (0, 0, 0))
        x, y, z = np.eye(3, dtype=LD)
        rotation = expm(hat3(z * yaw)) @ expm(hat3(y * pitch)) @ expm(hat3(x * roll))
        origin = rigid(rotation, vector(joint, "origin", "xyz", (0, 0, 0)))
        pose = origin @ rigid(turn, shift) @ pose
        tip = joint.find("parent").get("link")
    return pose


def vector(joint: ElementTree.Element, tag: str, name: str, default: Any) -> np.ndarray:
    element = joint.find(tag)
    text = None if element is None else element.get(name)
    return np.array(default if text is None else text.split(), dtype=np.float64).astype(LD)


def joint_xml(name: str, kind: str, parent: str, child: str, inside: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f"{inside}</joint>"
    )


def robot_xml(*joints: str, links: Any = "abcd", inside: str = "") -> str:
    names = "".join(f'<link name="{link}"/>' for link in links)
    return f'<robot name="arm">{names}{"".join(joints)}{inside}</robot>'


AXIS_Z = '<axis xyz="0 0 1"/>'
AB = joint_xml("j1", "revolute", "a", "b", AXIS_Z)
BC = joint_xml("j2", "continuous", "b", "c", '<origin xyz="1 0 0"/><axis xyz="0 1 0"/>')
CD = joint_xml("j3", "prismatic", "c", "d", '<limit lower="-1" upper="2"/>')
ARM = robot_xml(AB, BC, CD)


def words(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)


numbers = st.floats(-1, 1, allow_subnormal=False)
triples = st.tuples(numbers, numbers, numbers)
angles = st.one_of(st.floats(-7, 7), st.sampled_from([k * np.pi / 4 for k in range(-4, 5)]))
turns = st.tuples(angles, angles, angles)
directions = triples.filter(lambda v: max(map(abs, v)) > 1e-3)
lengths = st.sampled_from([1e-200, 1e-6, 1.0, 3.0, 1e9, 1e200])


class Chain(NamedTuple):
    xml: str
    tip: str
    names: tuple[str, ...]
    prismatic: list[bool]
    limits: list[tuple[float, float]]


@st.composite
def chains(draw: Any) -> Chain:
    """A chain of up to eight joints with a side branch, its joints in any order."""
    kinds = draw(
        st.lists(st.sampled_from(["revolute", "continuous", "prismatic", "fixed"]), max_size=7)
    )
    kinds.append(draw(st.sampled_from(["revolute", "continuous", "prismatic"])))
    kinds = draw(st.permutations(kinds))
    joints, moving = [], []
    for i, kind in enumerate(kinds):
        low, high = sorted(draw(st.tuples(numbers, numbers)))
        inside = f'<limit lower="{low!r}" upper="{high!r}" effort="1" velocity="1"/>'
        if draw(st.booleans()):
            inside += f'<origin xyz="{words(draw(triples))}" rpy="{words(draw(turns))}"/>'
        if draw(st.booleans()):
            scale = draw(lengths)
            inside += f'<axis xyz="{words(scale * x for x in draw(directions))}"/>'
        joints.append(joint_xml(f"j{i}", kind, f"l{i}", f"l{i + 1}", inside))
        if kind != "fixed":
            limits = (-INF, INF) if kind == "continuous" else (low, high)
            moving.append((f"j{i}", kind == "prismatic", limits))
    n = len(kinds)
    joints.append(joint_xml("side", "floating", f"l{draw(st.integers(0, n))}", "branch"))
    links = [*(f"l{i}" for i in range(n + 1)), "branch"]
    xml = robot_xml(*draw(st.permutations(joints)), links=draw(st.permutations(links)))
    return Chain(xml, f"l{n}", *zip(*moving))


# --- reading


@given(chains(), st.data())
def test_a_chain_moves_as_its_xml_says(chain: Chain, data: Any):
    robot = from_urdf(chain.xml, tip=chain.tip)
    assert robot.joint_names == chain.names
    np.testing.assert_array_equal(np.stack([robot.lower, robot.upper], 1), chain.limits)
    kinds = axes.joint_kinds(robot.screws)
    assert [kind == "prismatic" for kind in kinds] == list(chain.prismatic)
    assert "helical" not in kinds
    q = np.array(data.draw(st.lists(angles, min_size=len(kinds), max_size=len(kinds))))
    truth = walk(chain.xml, chain.tip, dict(zip(chain.names, q)))
    poses = product_of_exponentials(robot.screws, robot.home, q)
    np.testing.assert_allclose(poses, truth, rtol=0, atol=EXACT)


@given(chains(), st.data())
def test_between_any_two_links_is_the_part_of_the_chain(chain: Chain, data: Any):
    q = dict(zip(chain.names, data.draw(st.lists(angles, min_size=8, max_size=8))))
    last = int(chain.tip[1:])
    start = data.draw(st.integers(0, last - 1))
    names = [name for name in chain.names if int(name[1:]) >= start]
    if not names:
        with pytest.raises(ValueError, match="no joint moves between links 'l"):
            from_urdf(chain.xml, f"l{start}", chain.tip)
        return
    robot = from_urdf(chain.xml, f"l{start}", chain.tip)
    assert robot.joint_names == tuple(names)
    base = walk(chain.xml, f"l{start}", q)
    relative = rigid_inverse(base) @ walk(chain.xml, chain.tip, q)
    poses = product_of_exponentials(robot.screws, robot.home, [q[name] for name in names])
    np.testing.assert_allclose(poses, relative, rtol=0, atol=EXACT)


def test_the_parser_itself_finds_the_same_poses(rng):
    kinds = ["revolute", "fixed", "prismatic", "continuous", "revolute"]
    joints = [
        joint_xml(
            f"j{i}",
            kind,
            f"l{i}",
            f"l{i + 1}",
            f'<origin xyz="{words(rng.uniform(-1, 1, 3))}" rpy="{words(rng.uniform(-4, 4, 3))}"/>'
            f'<axis xyz="{words(unit_vectors(rng))}"/>',
        )
        for i, kind in enumerate(kinds)
    ]
    xml = robot_xml(*joints, links=[f"l{i}" for i in range(6)])
    robot = from_urdf(xml)
    model = yourdfpy.URDF.load(io.BytesIO(xml.encode()), load_meshes=False)
    for q in rng.uniform(-3, 3, (20, 4)):
        model.update_cfg(q)
        poses = product_of_exponentials(robot.screws, robot.home, q)
        np.testing.assert_allclose(poses, model.get_transform("l5", "l0"), rtol=0, atol=EXACT)


@pytest.mark.parametrize("model", nj.robots.MODELS.values(), ids=lambda model: model.name)
def test_the_niryo_descriptions_are_the_niryo_arms(model: Any):
    robot, arm = from_urdf(DATA / f"{model.name}.urdf"), model.robot()
    for field in ("screws", "home", "lower", "upper"):
        np.testing.assert_allclose(getattr(robot, field), getattr(arm, field), rtol=0, atol=EXACT)
    assert (robot.joint_names, robot.name) == (arm.joint_names, arm.name)
    assert robot.offset_wrist == arm.offset_wrist
    # Zeros and ones are exact, so both arms run in the same compiled programs.
    for ours, theirs in ((robot.screws, arm.screws), (robot.home, arm.home)):
        for number in (-1, 0, 1):
            np.testing.assert_array_equal(ours == number, theirs == number)
    q = np.linspace(-1, 1, 6)
    np.testing.assert_allclose(
        nj.forward_kinematics(robot, q), nj.forward_kinematics(arm, q), rtol=0, atol=EXACT
    )


def test_text_files_and_names(tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text(f'<?xml version="1.0" encoding="utf-8"?>\n<!-- an arm -->\n{ARM}')
    for source in (ARM, f"\n  {ARM}", str(file), file):
        robot = from_urdf(source)
        assert (robot.name, robot.joint_names) == ("arm", ("j1", "j2", "j3"))
    assert from_urdf(ARM, name="mine").name == "mine"
    assert from_urdf(ARM.replace(' name="arm"', "", 1)).name == "robot"
    np.testing.assert_array_equal(robot.lower, [-INF, -INF, -1])
    np.testing.assert_array_equal(robot.upper, [INF, INF, 2])


def test_shapes_meshes_and_inertias_do_not_matter():
    shapes = """<inertial><mass value="heavy"/></inertial>
        <visual><geometry><mesh filename="package://nowhere/a.stl"/></geometry></visual>
        <visual><geometry/></visual>
        <collision><geometry><mesh filename="missing.dae" scale="x"/></geometry></collision>"""
    xml = ARM.replace('<link name="b"/>', f'<link name="b">{shapes}</link>').replace(
        AXIS_Z, f'{AXIS_Z}<dynamics damping="?"/><safety_controller soft_lower_limit="1"/>'
    )
    xml = xml.replace(
        "</robot>", '<transmission name="t"><joint name="j1"/></transmission><gazebo/></robot>'
    )
    np.testing.assert_array_equal(from_urdf(xml).screws, from_urdf(ARM).screws)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize(
    ("limit", "expected"),
    [
        ("", (-INF, INF)),
        ('<limit effort="1" velocity="1"/>', (-INF, INF)),
        ('<limit upper="0.5"/>', (0, 0.5)),
        ('<limit lower="-0.5"/>', (-0.5, 0)),
        ('<limit lower="-inf" upper="1e308"/>', (-INF, 1e308)),
        (f'<limit lower="0" upper="{sys.float_info.max!r}"/>', (0, INF)),
        (
            '<limit lower="0" upper="1"/><safety_controller soft_lower_limit="0.1" '
            'soft_upper_limit="0.2" k_velocity="1"/>',
            (0, 1),
        ),
    ],
)
def test_limits_that_are_missing_in_part_or_whole(kind, limit, expected):
    robot = from_urdf(robot_xml(joint_xml("j", kind, "a", "b", limit), links="ab"))
    assert (robot.lower[0], robot.upper[0]) == expected


def test_joints_beside_the_chain_may_be_anything():
    beside = joint_xml("odd", "ball", "b", "d", '<axis xyz="0 0 0"/><mimic joint="j1"/>')
    robot = from_urdf(robot_xml(AB, BC, beside), tip="c")
    assert robot.joint_names == ("j1", "j2")
    with pytest.raises(ValueError, match="'odd' on the chain is of type 'ball'"):
        from_urdf(robot_xml(AB, BC, beside), tip="d")


def test_a_fixed_joint_that_mimics_is_fixed():
    fixed = joint_xml("f", "fixed", "b", "c", '<mimic joint="j1"/>')
    assert from_urdf(robot_xml(AB, fixed, links="abc")).joints == 1


MIMIC_IN = joint_xml("m", "revolute", "c", "d", '<mimic joint="j2" multiplier="-1"/>')
MIMIC_OUT = joint_xml("m", "revolute", "c", "d", '<mimic joint="elsewhere"/>')


@pytest.mark.parametrize(
    ("xml", "chain", "message"),
    [
        ("<robot", {}, "path: expected XML; unclosed token: line 1"),
        ("<robot name='a'><link name='a'></robot>", {}, "path: expected XML; mismatched tag"),
        ("<sdf/>", {}, "expected the root element <robot>, got <sdf>"),
        (
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>',
            {},
            "expand it with the program xacro",
        ),
        ('<robot name="a"/>', {}, "expected one tree of links; got 0"),
        (robot_xml(links="a"), {}, "no joint moves between links 'a' and 'a'"),
        (robot_xml("<joint/>"), {}, "a joint has no name"),
        (robot_xml("<link/>"), {}, "a link has no name"),
        (robot_xml('<joint name="j"/>'), {}, "joint 'j' has no type"),
        (robot_xml('<joint name="j" type="fixed"/>'), {}, "joint 'j', <parent>, has no link"),
        (robot_xml(AB.replace('link="b"', "")), {}, "joint 'j1', <child>, has no link"),
        (ARM.replace("0 0 1", "0 0"), {}, "'j1', <axis> xyz: expected 3 finite numbers, got '0 0'"),
        (ARM.replace("0 0 1", "1"), {}, "expected 3 finite numbers, got '1'"),
        (ARM.replace("0 0 1", "0 0 nan"), {}, "expected 3 finite numbers, got '0 0 nan'"),
        (ARM.replace("0 0 1", "0 0 inf"), {}, "expected 3 finite numbers, got '0 0 inf'"),
        (ARM.replace("0 0 1", "0 0 0"), {}, "joint 'j1': expected an axis that is not zero"),
        (ARM.replace("1 0 0", "1 0 inf"), {}, "<origin> xyz: expected 3 finite numbers"),
        (
            ARM.replace("1 0 0", "1 0 ${x}"),
            {},
            "<origin> xyz: expected 3 finite numbers, got '1 0 ",
        ),
        (ARM.replace('"-1"', '"low"'), {}, "'j3', <limit> lower: expected a number, got 'low'"),
        (ARM.replace('"-1"', '"3"'), {}, "joint 'j3': lower 3.0 exceeds upper 2.0"),
        (robot_xml(AB, BC, links="abca"), {}, "link names must be distinct, got 'a' more than"),
        (robot_xml(AB, BC.replace("j2", "j1"), links="abc"), {}, "joint names must be distinct"),
        (robot_xml(AB, BC, links="ab"), {}, "joint 'j2': its child 'c' is no link"),
        (robot_xml(AB, BC, links="bc"), {}, "joint 'j1': its parent 'a' is no link"),
        (robot_xml(AB, BC, CD, links="abcdxy"), {}, "got 3 without a parent: 'a', 'x', 'y'"),
        (
            robot_xml(AB, joint_xml("x", "fixed", "c", "b"), links="abc"),
            {},
            "link 'b' is the child of two joints, 'j1' and 'x'",
        ),
        (
            robot_xml(AB, BC, joint_xml("x", "fixed", "c", "a"), links="abc"),
            {},
            "joints 'j1', 'j2', 'x' form a loop",
        ),
        (
            robot_xml(AB, joint_xml("x", "fixed", "c", "d"), joint_xml("y", "fixed", "d", "c")),
            {},
            "form a loop",
        ),
        (
            robot_xml(AB, joint_xml("x", "fixed", "b", "c"), joint_xml("y", "fixed", "b", "d")),
            {},
            "tip: several chains start at link 'a'; choose one of 'c', 'd'",
        ),
        (ARM, {"base": "x"}, "base: no link is named 'x'; the links: 'a', 'b', 'c', 'd'"),
        (ARM, {"tip": "x"}, "tip: no link is named 'x'"),
        (ARM, {"base": "c", "tip": "b"}, "tip: link 'b' is not below the base link 'c'"),
        (ARM, {"base": "d"}, "no joint moves between links 'd' and 'd'"),
        (ARM, {"tip": "a"}, "no joint moves between links 'a' and 'a'"),
        (ARM.replace("continuous", "planar"), {}, "joint 'j2' on the chain is of type 'planar'"),
        (ARM.replace("continuous", "floating"), {}, "joint 'j2' on the chain is of type 'floa"),
        (robot_xml(AB, BC, MIMIC_IN), {}, "'m' on the chain mimics joint 'j2', which is on the"),
        (robot_xml(AB, BC, MIMIC_OUT), {}, "mimics joint 'elsewhere', which is not on the chain"),
    ],
)
def test_mistakes_are_named(xml, chain, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        from_urdf(xml, **chain)


def test_a_missing_file_and_a_missing_parser(tmp_path, monkeypatch):
    with pytest.raises(FileNotFoundError, match=r"path: 'absent\.urdf' is no file"):
        from_urdf("absent.urdf")
    with pytest.raises(FileNotFoundError, match="is no file"):
        from_urdf(tmp_path)
    monkeypatch.setitem(sys.modules, "yourdfpy", None)
    with pytest.raises(ImportError, match=re.escape('pip install "niryo_jax[urdf]"')):
        from_urdf(ARM)


# --- writing


def assert_same(back: nj.Robot, robot: nj.Robot) -> None:
    for field in ("screws", "home"):
        np.testing.assert_allclose(getattr(back, field), getattr(robot, field), rtol=0, atol=EXACT)
    np.testing.assert_array_equal(back.lower, robot.lower)
    np.testing.assert_array_equal(back.upper, robot.upper)
    assert (back.joint_names, back.name) == (robot.joint_names, robot.name)


bounds = st.one_of(st.floats(-10, 10), st.sampled_from([-INF, INF, 1e308]))
labels = st.text(st.characters(exclude_categories=["C"]), min_size=1)


@given(st.data())
def test_a_robot_that_is_written_and_read_is_the_same(data: Any):
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    n = data.draw(st.integers(1, 8))
    prismatic = [i for i in range(n) if data.draw(st.booleans())]
    limits = np.array([sorted(data.draw(st.tuples(bounds, bounds))) for _ in range(n)])
    names = data.draw(st.lists(labels, min_size=n, max_size=n, unique=True))
    robot = dataclasses.replace(
        random_robot(rng, n, prismatic=prismatic),
        lower=limits[:, 0],
        upper=limits[:, 1],
        joint_names=tuple(names),
        name=data.draw(labels),
    )
    assert_same(from_urdf(to_urdf(robot)), robot)


@given(angles, angles, st.sampled_from([-1, 1]), st.floats(-1e-6, 1e-6))
def test_the_tool_keeps_its_rotation_at_gimbal_lock(roll, yaw, sign, off):
    x, y, z = np.eye(3)
    pitch = sign * np.pi / 2 + off
    rotation = expm(hat3(z * yaw)) @ expm(hat3(y * pitch)) @ expm(hat3(x * roll))
    home = rigid(rotation, np.array([0.1, 0.2, 0.3])).astype(float)
    robot = nj.Robot.from_screws([[0, 0, 1, 0, 0, 0]], home)
    assert_same(from_urdf(to_urdf(robot)), robot)


def test_limits_that_are_infinite_come_back_infinite():
    robot = nj.Robot.from_axes(
        [[0, 0, 1]] * 4,
        [[0, 0, 0]] * 4,
        np.eye(4),
        prismatic=[False, False, True, True],
        lower=[-INF, -INF, -INF, 0],
        upper=[INF, 1, INF, INF],
        joint_names=["a", "b", "c", "tool_joint"],
    )
    xml = to_urdf(robot)
    assert_same(from_urdf(xml), robot)
    kinds = [joint.get("type") for joint in ElementTree.fromstring(xml).findall("joint")]
    assert kinds == ["continuous", "revolute", "prismatic", "prismatic", "fixed"]


def test_the_text_is_written_to_the_file(tmp_path, niryo):
    file = tmp_path / "arm.urdf"
    assert to_urdf(niryo, file) == file.read_text(encoding="utf-8")
    assert_same(from_urdf(file), niryo)


def test_robots_that_urdf_cannot_hold(rng, niryo):
    with pytest.raises(ValueError, match="joint 'joint_2' is helical"):
        to_urdf(random_robot(rng, 3, helical=[1]))
    with pytest.raises(ValueError, match="joint names must be distinct, got 'a' more than once"):
        to_urdf(dataclasses.replace(niryo, joint_names=tuple("abcade")))
    with pytest.raises(ValueError, match="expected a name for every joint"):
        to_urdf(dataclasses.replace(niryo, joint_names=("", *"bcdef")))
    with pytest.raises(ValueError, match="expected one robot"):
        to_urdf(jax.tree.map(lambda leaf: np.stack([leaf, leaf]), niryo))
    with pytest.raises(TypeError, match="traced robot"):
        jax.jit(lambda robot: len(to_urdf(robot)))(niryo)


@pytest.mark.parametrize("declared", ["", ' xmlns:drake="http://drake.mit.edu"', ' xmlns="a:b"'])
def test_prefixes_say_nothing_of_how_a_robot_moves(declared):
    plain = ARM.replace(' name="arm"', ' name="arm"' + declared, 1)
    more = plain.replace("<limit ", '<limit drake:acceleration="2.5" ').replace(
        "</robot>", '<drake:joint name="c"/></robot>'
    )
    read, other = from_urdf(ARM), from_urdf(more)
    for name in ("screws", "home", "lower", "upper", "joint_names"):
        np.testing.assert_array_equal(getattr(read, name), getattr(other, name))


@pytest.mark.parametrize("prefix", ["xacro", "x"])
@pytest.mark.parametrize("uri", ["http://www.ros.org/wiki/xacro", "http://ros.org/wiki/xacro/"])
def test_what_xacro_has_to_replace_is_seen_whatever_its_prefix(prefix, uri):
    text = f'<robot xmlns:{prefix}="{uri}"><{prefix}:arm/></robot>'
    with pytest.raises(ValueError, match="expand it with the program xacro"):
        from_urdf(text)


@pytest.mark.parametrize("path", [None, 5, object(), ["arm.urdf"], np.zeros(3)])
def test_what_is_no_path_is_named(path):
    with pytest.raises(TypeError, match=r"^path: expected a path, got"):
        from_urdf(path)
    if path is not None:
        with pytest.raises(TypeError, match=r"^path: expected a path, got"):
            to_urdf(nj.robots.niryo_one(), path)
    with pytest.raises(TypeError, match=r"^tip: expected a text, got"):
        from_urdf(ARM, tip=5)
