"""Ctrl-C at any time of a command ends it in one line; other programs keep their own.

What Python does before it is at the package is not the package's: `-X importtime` tells when it is.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("typer")
pytest.importorskip("rich")

posix = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
IK = ["ik", "0.148", "-0.148", "0.088", "--rpy", "0", "90", "0", "--degrees"]
MAP = ["workspace", "map", "niryo_one", "--dry-run"]
SCRIPT = "import sys\nfrom niryo_jax.cli import main\nsys.exit(main())\n"


def interrupted(how: list[str], arguments: list[str], delay: float, folder):
    """A command that is interrupted so many seconds after the package has begun: its exit code,
    its stdout, and its stderr less what was asked of Python."""
    log = folder / "stderr"
    with log.open("w") as stderr:
        process = subprocess.Popen(
            [sys.executable, "-X", "importtime", *how, *arguments],
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
        )
        while "niryo_jax.interruption" not in log.read_text():
            assert process.poll() is None
            time.sleep(0.005)
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=120)
    # The line of a module may be cut where the process ends.
    said = [line for line in log.read_text().splitlines() if not line.startswith("import time:")]
    return process.returncode, out, "\n".join(said)


@posix
@pytest.mark.parametrize(
    ("delay", "as_json"),
    [(0.0, 0), (0.05, 1), (0.1, 0), (0.2, 1), (0.4, 0), (0.7, 1), (1.0, 0), (2.0, 1), (3.0, 0)],
)
def test_ctrl_c_at_any_time_ends_in_one_line(tmp_path, delay, as_json):
    how, arguments = ["-m", "niryo_jax.cli"], IK
    if as_json:
        script = tmp_path / "niryo-jax"
        script.write_text(SCRIPT)
        how, arguments = [str(script)], [*IK, "--json"]
    code, out, err = interrupted(how, arguments, delay, tmp_path)
    if code == 0:
        assert delay > 0.2, "no command is that quick"
        assert err == ""
        assert out
    else:
        assert code == 130
        assert (out, err) == ("", "error: interrupted") if not as_json else err == ""
    if as_json:
        document = json.loads(out)
        assert document == {"error": "interrupted", "exit_code": 130} or code == 0


@posix
@pytest.mark.parametrize("delay", [0.1, 2.0])
def test_ctrl_c_before_a_map_is_begun(tmp_path, delay):
    pytest.importorskip("zarr")
    code, out, err = interrupted(["-m", "niryo_jax.cli"], MAP, delay, tmp_path)
    assert code in (0, 130)
    assert code == 0 or (out, err) == ("", "error: interrupted")


ASKED = "import signal, niryo_jax; print(repr(signal.getsignal(signal.SIGINT)))"


def handler(*command: str, **options) -> str:
    """What a program says of its handler of Ctrl-C."""
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, **options)
    return done.stdout.strip()


@posix
def test_other_programs_keep_their_own_ctrl_c(tmp_path):
    python = sys.executable
    own = handler(python, "-c", "import signal; print(repr(signal.getsignal(signal.SIGINT)))")
    assert "default_int_handler" in own
    path = os.pathsep.join([str(tmp_path), *sys.path])
    assert handler(python, "-c", ASKED, "niryo_jax.cli", "niryo-jax") == own
    # A package of its own is imported while Python has no name for the program yet.
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "__init__.py").write_text(ASKED)
    (tmp_path / "package" / "__main__.py").write_text("")
    assert handler(python, "-m", "package", env={**os.environ, "PYTHONPATH": path}) == own
    # A process that the command starts takes its name over, not its line.
    assert handler(python, "-c", f"import sys; sys.argv = ['/bin/niryo-jax', 'ik']; {ASKED}") == own


@posix
def test_an_ignored_ctrl_c_stays_ignored(tmp_path):
    script = tmp_path / "niryo-jax"
    script.write_text(ASKED)
    assert "function _end" in handler(sys.executable, str(script))
    in_background = f"trap '' INT; exec '{sys.executable}' '{script}'"
    assert "SIG_IGN" in handler("sh", "-c", in_background)
