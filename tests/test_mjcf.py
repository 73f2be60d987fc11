"""MJCF in: against the poses that MuJoCo itself finds, and every mistake."""

from __future__ import annotations

import math
import re
import sys

import numpy as np
import pytest

pytest.importorskip("mujoco")

import mujoco
from support import product_of_exponentials

from niryo_jax.robots.mjcf import from_mjcf

EXACT = 1e-12
BODIES = """
    <body name="turret" pos="0.1 0.2 0.3" euler="10 20 30" childclass="arm">
      <joint name="turn" ref="20" range="-90 30" axis="1 1 0" pos="0.01 0.05 0"/>
      {turret}
      <body name="rail" pos="0 0.3 0.5" quat="1 2 3 4">
        <joint name="slide" type="slide" axis="0.3 0 -2" ref="0.1"/>
        <joint name="roll" axis="0 0 3"/>
        <body name="mount" pos="0.1 0 0" euler="0 40 0">
          <body name="hand" pos="0 0 0.2">
            <joint pos="0 0.1 0"/>
            <site name="tip" pos="0.1 0 0.1" euler="90 0 10"/>
            {hand}
          </body>
        </body>
      </body>
    </body>
"""


def model(turret: str = "", hand: str = "", world: str = "", rest: str = "") -> str:
    return f"""
    <mujoco model="crane">
      <compiler angle="degree" eulerseq="zyx"/>
      <default><default class="arm"><joint axis="0 1 0"/></default></default>
      <worldbody>{world}{BODIES.format(turret=turret, hand=hand)}</worldbody>
      {rest}
    </mujoco>"""


MASS = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
SOLID = (
    model(turret=MASS, hand=MASS)
    .replace('type="slide"', 'type="slide" damping="0"')
    .replace('<body name="mount"', f'{MASS}<body name="mount"')
)


@pytest.mark.parametrize(
    ("base", "tip", "first"), [(None, "tip", 0), (None, None, 0), ("turret", "hand", 1)]
)
def test_a_chain_moves_as_in_mujoco(rng, base, tip, first):
    robot = from_mjcf(SOLID, base, tip)
    assert robot.joints == 4 - first
    truth = mujoco.MjModel.from_xml_string(SOLID)
    data = mujoco.MjData(truth)
    for q in rng.uniform(-2, 2, (20, 4)):
        data.qpos[:] = q
        mujoco.mj_kinematics(truth, data)
        end = data.site("tip") if tip == "tip" else data.body("hand")
        start = data.body("world" if base is None else base)
        expected = np.linalg.inv(pose(start)) @ pose(end)
        found = product_of_exponentials(robot.screws, robot.home, q[first:])
        np.testing.assert_allclose(found, expected, rtol=0, atol=EXACT)


def pose(frame) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = frame.xmat.reshape(3, 3), frame.xpos
    return out


def test_names_and_limits():
    robot = from_mjcf(SOLID)
    assert (robot.name, robot.joint_names) == ("crane", ("turn", "slide", "roll", "joint_4"))
    np.testing.assert_allclose(robot.lower, [-math.pi / 2, -np.inf, -np.inf, -np.inf], rtol=1e-15)
    np.testing.assert_allclose(robot.upper, [math.pi / 6, np.inf, np.inf, np.inf], rtol=1e-15)
    assert from_mjcf(SOLID, name="mine").name == "mine"


def test_shapes_meshes_and_what_uses_them_do_not_matter(tmp_path):
    xml = model(
        turret='<geom type="mesh" mesh="shell" material="paint"/><inertial pos="0 0 0" mass="0" '
        'diaginertia="0 0 0"/>',
        hand='<site name="spot" material="paint"/>',
        rest="""
        <asset>
          <mesh name="shell" file="missing.stl"/>
          <texture name="wood" type="2d" file="missing.png"/>
          <material name="paint" texture="wood"/>
        </asset>
        <tendon><fixed name="rope"><joint joint="roll" coef="1"/></fixed></tendon>
        <actuator><motor joint="turn"/><motor tendon="rope"/></actuator>
        <sensor><jointpos joint="turn"/></sensor>
        <keyframe><key qpos="0 0 0 0" ctrl="0 0"/></keyframe>""",
    )
    file = tmp_path / "crane.xml"
    file.write_text(xml)
    for source in (xml, str(file), file):
        robot = from_mjcf(source, tip="tip")
        np.testing.assert_array_equal(robot.screws, from_mjcf(SOLID, tip="tip").screws)


COUPLED = '<equality><joint joint1="slide" joint2="roll"/></equality>'


@pytest.mark.parametrize(
    ("xml", "chain", "message"),
    [
        ("<mujoco", {}, "path: XML"),
        (model(rest="<nonsense/>"), {}, "path: "),
        (SOLID, {"base": "x"}, "base: no body is named 'x'; the bodies: 'world', 'turret'"),
        (SOLID, {"tip": "x"}, "tip: no body is named 'x'"),
        (SOLID, {"base": "hand", "tip": "rail"}, "body 'rail' is not below the base body 'hand'"),
        (SOLID, {"base": "hand"}, "no joint moves between bodies 'hand' and 'hand'"),
        (SOLID, {"base": "rail", "tip": "mount"}, "no joint moves between bodies 'rail' and"),
        (model(hand='<body name="a"/><body name="b"/>'), {}, "choose one of: 'a', 'b'"),
        (model(hand='<body name="a"><joint type="ball" name="knob"/></body>'), {}, "'knob' on the"),
        (model(rest=COUPLED), {}, "an equality constraint couples joint 'slide' on the chain"),
    ],
)
def test_mistakes_are_named(xml, chain, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        from_mjcf(xml, **chain)


def test_a_missing_file_and_a_missing_reader(tmp_path, monkeypatch):
    with pytest.raises(FileNotFoundError, match=r"path: 'absent\.xml' is no file"):
        from_mjcf("absent.xml")
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ImportError, match=re.escape('pip install "niryo_jax[mjcf]"')):
        from_mjcf(SOLID)
