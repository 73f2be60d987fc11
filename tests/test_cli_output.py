"""What the command writes: results to be copied, streams that are lost, terminals of all kinds."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("rich")

import niryo_jax as nj
from niryo_jax.cli import console
from niryo_jax.cli.tables import digits

posix = pytest.mark.skipif(os.name == "nt", reason="streams of POSIX")
COMMAND = [sys.executable, "-m", "niryo_jax.cli"]


# --- results that are copied


def words_after(label: str, text: str) -> list[str]:
    """The numbers behind a label, as a shell cuts a pasted line into words."""
    (line,) = [line for line in text.splitlines() if line.startswith(label)]
    return line.split(")")[1].split()


def pasted_joints(text: str) -> list[list[str]]:
    """The joint vectors with all their digits, as a shell cuts them."""
    lines = text[text.index("All digits") :].splitlines()[1:]
    return [line.split()[1:] for line in lines if re.match(r" *\d+  ", line)]


@pytest.mark.parametrize("name", ["niryo_one", "abb_irb910sc"])
@pytest.mark.parametrize("unit", ["--degrees", "--radians"])
def test_what_fk_prints_goes_into_ik_and_back(cli, rng, name, unit):
    robot = nj.robots.load(name)
    chosen = (unit, "--robot", name)
    for _ in range(2):
        q = rng.uniform(robot.lower, robot.upper)
        slides = np.array([kind == "p" for kind in "rrpr"]) if name == "abb_irb910sc" else False
        given = np.where(slides, q, np.rad2deg(q)) if unit == "--degrees" else q
        code, out, err = cli("fk", *digits(given).split(), *chosen)
        assert (code, err) == (0, "")
        expected = np.asarray(nj.forward_kinematics(robot, q))
        rows = out[out.index("pose (m)\n") + 9 :].splitlines()[:4]
        np.testing.assert_allclose(np.loadtxt(rows), expected, rtol=0, atol=3e-12)
        place = words_after("position (m)", out), words_after("roll pitch yaw", out)
        for pose in (["--matrix", "\n".join(rows)], [*place[0], "--rpy", *place[1]]):
            code, solved, err = cli("ik", *pose, *chosen)
            assert (code, err) == (0, "")
            for joints in pasted_joints(solved):
                back = cli("fk", *joints, *chosen)[1]
                rows_back = back[back.index("pose (m)\n") + 9 :].splitlines()[:4]
                np.testing.assert_allclose(np.loadtxt(rows_back), expected, rtol=0, atol=2e-11)
                # As in Python, between brackets.
                assert len(eval(f"[{' '.join(joints)}]")) == robot.joints


def test_digits_are_all_that_matter_and_no_more(rng):
    values = rng.normal(size=200) * 10.0 ** rng.integers(-14, 4, 200)
    shown = [float(word) for word in digits(values).split(", ")]
    np.testing.assert_allclose(shown, values, rtol=0, atol=5.01e-13)
    assert digits([-0.0, -1e-13, 45, 0.1, 1e300]).startswith("0.0, 0.0, 45.0, 0.1, 1000000000")
    assert "e" not in digits(values)


def test_numbers_are_read_as_people_write_them(as_json):
    q = [-45.0, 1.5, -0.25, 0, 2, 3]
    expected = as_json("fk", *q, "--degrees")
    assert expected[0] == 0
    for text in (
        "-45, 1.5, -.25, 0, 2, 3",
        "[-45.0, 1.5, -0.25, 0., 2e0, 3]",
        "\N{MINUS SIGN}45;1.5;\N{MINUS SIGN}0.25;0;2;3",
        "(-45 1.5 -25e-2\n0 2 3)",
    ):
        assert as_json("fk", text, "--degrees") == expected
        assert as_json("fk", *text.split(), "--degrees") == expected


def test_a_pose_is_read_from_standard_input(as_json, monkeypatch, tmp_path):
    pose = np.asarray(nj.forward_kinematics(nj.robots.niryo_one(), [0.1] * 6))
    file = tmp_path / "pose.json"
    file.write_text(str(pose.tolist()))
    expected = as_json("ik", "--pose-file", file, "--radians")
    with file.open() as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        assert as_json("ik", "--pose-file", "-", "--radians") == expected
    monkeypatch.setattr(sys, "stdin", None)
    code, document = as_json("ik", "--pose-file", "-", "--radians")
    assert code == 2
    assert "standard input is closed" in document["error"]


# --- tables


@pytest.mark.parametrize("width", [1, 20, 40, 80, 200])
def test_no_number_is_cut_however_narrow_the_terminal(cli, monkeypatch, width):
    plain = console.stdout
    at_width = [("ik", "0.148", "-0.148", "0.088", "--rpy", "0", "90", "0", "--degrees")]
    at_width += [("pick-and-place", "--dry-run")]
    for command in at_width:
        expected = re.findall(r"-?\d+\.\d+", cli(*command)[1])
        with monkeypatch.context() as patch:

            def narrow():
                made = plain()
                made.width = width
                return made

            patch.setattr(console, "stdout", narrow)
            shown = cli(*command)[1]
        assert re.findall(r"-?\d+\.\d+", shown) == expected
        assert "\N{HORIZONTAL ELLIPSIS}" not in shown


def test_names_that_look_like_markup_are_shown_as_they_are(cli, tmp_path):
    pytest.importorskip("yourdfpy")
    file = tmp_path / "arm.urdf"
    file.write_text(
        '<robot name="[red]:b:"><link name="a"/><link name="b"/>'
        '<joint name="[bold]j:b:" type="continuous"><parent link="a"/><child link="b"/>'
        '<axis xyz="0 0 1"/></joint></robot>'
    )
    assert cli("describe", file)[1].startswith("[red]:b:: 1 joints\n  [bold]j:b:: revolute")
    _, _, err = cli("pick-and-place", "--host", "[red]:b:x")
    assert "got '[red]:b:x'" in err


# --- streams that are lost


def shell(line: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """A line of a shell in which $NJ is the command, its stderr and the exit code of $NJ."""
    script = f'set -o pipefail; NJ="{sys.executable} -m niryo_jax.cli"; {line}'
    env = {**os.environ, **environment}
    return subprocess.run(["bash", "-c", script], capture_output=True, text=True, env=env)


FK = "fk 0 0 0 0 0 0 --degrees"


@posix
@pytest.mark.parametrize("command", ["describe", f"{FK} --json", "fk 0 --degrees --json", "--help"])
def test_lost_output_ends_in_words(command):
    for line, code, sentence in (
        (f"$NJ {command} >/dev/full", 7, "error: cannot write to standard output: No space left"),
        (f"$NJ {command} >&-", 7, "error: standard output is closed"),
        (f"$NJ {command} | true", 141, "error: the program that read the output ended"),
    ):
        done = shell(line)
        assert done.returncode == code, line
        assert done.stderr.startswith(sentence)
        assert len(done.stderr.splitlines()) == 1
        assert done.stdout == ""


@posix
def test_lost_remarks_lose_no_result():
    expected = shell("$NJ fk 0 0 0 0 0 170 --degrees")
    assert expected.stderr.startswith("note: ")
    for lost in ("2>&-", "2>/dev/full <&-"):
        done = shell(f"$NJ fk 0 0 0 0 0 170 --degrees {lost}")
        assert (done.returncode, done.stdout, done.stderr) == (0, expected.stdout, "")
    failed = shell("$NJ fk 0 --degrees 2>&-")
    assert (failed.returncode, failed.stdout) == (2, "")


@posix
def test_any_locale_and_terminal_will_do():
    for environment in (
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        {"PYTHONIOENCODING": "ascii"},
        {"TERM": "dumb", "NO_COLOR": "1", "COLUMNS": "40"},
    ):
        done = shell("$NJ robots; $NJ describe \u00e9\N{MINUS SIGN}", **environment)
        assert "niryo_one" in done.stdout
        assert done.returncode == 2
        assert done.stderr.startswith("error: Invalid value: ROBOT:")


@posix
def test_ctrl_c_ends_in_a_word():
    command = [*COMMAND, "pick-and-place", "--time-scale", "0.01"]
    pytest.importorskip("pyniryo")
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        while "Driving" not in (line := process.stderr.readline()):
            assert line
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        said = process.stderr.read()
        assert process.wait(timeout=60) == 130
    assert "error: interrupted" in said.splitlines()[-1]
    assert "Traceback" not in said


@posix
def test_files_that_cannot_be_written_are_named():
    # With a second command the shell stays, and is the one that is found.
    done = shell("$NJ --install-completion; exit $?", HOME=os.devnull)
    assert (done.returncode, done.stdout) == (2, "")
    assert os.devnull in done.stderr
    assert "Traceback" not in done.stderr


# --- completion


@posix
@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        (["d"], {"describe"}),
        (["describe", "abb_irb12"], {"abb_irb120", "abb_irb120_up"}),
        (["ik", "--robot", "kuk"], {"kuka_iiwa14"}),
        (["workspace", "map", "ur"], {"ur16e"}),
        (["describe", "./no_robot"], set()),
    ],
)
def test_a_shell_completes_commands_and_robots(typed, completed):
    env = {
        **os.environ,
        "_NIRYO_JAX_COMPLETE": "complete_bash",
        "COMP_WORDS": " ".join(["niryo-jax", *typed]),
        "COMP_CWORD": str(len(typed)),
    }
    done = subprocess.run(COMMAND, capture_output=True, text=True, env=env)
    assert (done.returncode, done.stderr) == (0, "")
    assert set(done.stdout.split()) == completed


@posix
def test_completion_is_installed(tmp_path):
    pytest.importorskip("shellingham")
    done = shell("$NJ --install-completion; exit $?", HOME=str(tmp_path))
    assert (done.returncode, done.stderr) == (0, "")
    (script,) = (tmp_path / ".bash_completions").iterdir()
    assert "_NIRYO_JAX_COMPLETE=complete_bash" in script.read_text()
    assert script.name in (tmp_path / ".bashrc").read_text()
