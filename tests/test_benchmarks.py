"""The benchmarks' own gates: every answer that they time is right."""

from __future__ import annotations

import dataclasses
import json
import xml.etree.ElementTree

import numpy as np
import pytest

from benchmarks import collision, floors, kinematics, lanes, lie, measure, motion, velocity
from benchmarks.kinematics_peers import PACKAGES, urdf

PEERS = [name for name in PACKAGES if name != "numpy"]


def test_kinematics():
    report = kinematics.measure([], 256, 1, PEERS)
    assert not report.wrong
    assert set(report.data["absent"]) == set(PEERS)
    tables = [section for section in report.sections if section.startswith("| what")]
    assert tables[0].count("plain numpy") == 2
    assert len(report.claims) == 12


def test_a_wrong_answer_fails_the_run(monkeypatch, capsys):
    right = kinematics.nj.forward_kinematics
    monkeypatch.setattr(kinematics.nj, "forward_kinematics", lambda *x: right(*x) + 1e-9)
    inputs, report = kinematics.Inputs(16), measure.Report("", {})
    kinematics.compare(inputs, [], "float64", 16, 1, report, [])
    assert len(report.wrong) == 2, "forward kinematics, and pose and Jacobian together"
    assert report.finish(None) == 1
    assert "WRONG: forward kinematics" in capsys.readouterr().out


def test_collision():
    report = measure.Report("", {})
    assert np.isnan(collision.measure(64, 4, 1, report, skip=tuple(collision.PEERS)))
    assert not report.wrong
    assert report.sections[-1].count("niryo_jax, clearance") == 6


def test_motion():
    report = measure.Report("", {})
    motion.measure(32, 2, 2, 1, report, skip=("toppra", "ruckig"))
    assert not report.wrong
    assert len(report.claims) == 7


def test_velocity():
    report, peers = measure.Report("", {}), ("numpy", "qpax", "scipy")
    velocity.measure(velocity.nj.robots.niryo_one(), 64, 1, report, skip=peers)
    assert not report.wrong
    assert report.sections[-1].count("niryo_jax, float") == 4
    case = velocity.Case(velocity.nj.robots.niryo_one(), 64)
    found = case.ours("float64", True)()
    off = dataclasses.replace(found, rate=1.001 * found.rate)
    assert len(case.wrong(off, "float64", True)) == 3, "limits, optimum, twists"


@pytest.mark.parametrize("part", [lie, lanes])
def test_functions_of_one_layer(part):
    assert not part.measure(64, 1).wrong


def test_floors_count_each_operation_once():
    floor = floors.floor_of(lambda x: x[0] * x[1] + x[2], 128, "float64", 1, (3,))
    assert floor.operations == 2
    assert floor.size == 32


def test_a_report_is_written_as_table_and_data(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(measure, "RESULTS", tmp_path)
    report = measure.Report("Title", {"about": {}}, ["text"], [measure.Claim("fast", True)])
    assert report.finish("stem") == 0
    (page,), (data,) = tmp_path.glob("*-stem.md"), tmp_path.glob("*-stem.json")
    assert page.read_text().startswith("# Title\n\ntext\n\n## Claims\n\n- fast: pass")
    assert json.loads(data.read_text())["claims"] == [["fast", "pass"]]
    capsys.readouterr()


def test_peers_get_the_arm(niryo):
    tree = xml.etree.ElementTree.fromstring(urdf(niryo))
    origins = [x.get("xyz").split() for x in tree.iter("origin")]
    steps = np.array(origins, float)
    np.testing.assert_allclose(steps.sum(axis=0), np.asarray(niryo.home)[:3, 3], atol=1e-15)
