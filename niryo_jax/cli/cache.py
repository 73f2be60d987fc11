"""Programs kept between calls of the command, which would spend its time making them.

Only the command does this: a library sets nothing on import. A kept program is machine code, and
is read with `pickle`: it is taken only from a folder and a file that no one else can write.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import platform
import stat
import tempfile
import zlib
from pathlib import Path

import jax
import platformdirs

import niryo_jax
from niryo_jax._jax import Compiled

VARIABLE = "NIRYO_JAX_CACHE_DIR"
"""Where programs are kept; the platform's cache folder where it is not set, nowhere if empty."""

_MOST = 256 * 2**20
"""Bytes of all programs; the oldest make room."""

_DIGEST = hashlib.sha256().digest_size


def keep_programs() -> None:
    """Keep programs, unless the caller's JAX does already or there is no folder to trust."""
    chosen = os.environ.get(VARIABLE)
    if chosen == "" or os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        return
    parent = Path(chosen) if chosen else platformdirs.user_cache_path("niryo_jax")
    folder = parent / "private"
    if not _made_private(folder):
        return
    Compiled.store = KeptPrograms(folder)
    # Small programs are not worth a file of ours: JAX keeps them, and what a program is lowered to.
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.02)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


class KeptPrograms:
    """Serialised programs as files of a folder.

    A file that is damaged, of another key, version or machine, or not this user's own is as good as
    none. Nothing is raised where a file cannot be read or written.

    Args:
        folder: a folder of this user's.
        most: bytes of all files together; the ones that were not used for longest make room.
    """

    def __init__(self, folder: Path, most: int = _MOST) -> None:
        self._folder, self._most = folder, most

    def load(self, key: str) -> bytes | None:
        """The program of a key as it was saved; None where there is none."""
        path = self._path(key)
        with contextlib.suppress(OSError, zlib.error), path.open("rb") as file:
            if not _is_own(os.fstat(file.fileno())):
                return None
            content = file.read()
            if content[:_DIGEST] != _digest(path.name, content[_DIGEST:]):
                return None
            program = zlib.decompress(content[_DIGEST:])
            os.utime(path)
            return program
        return None

    def save(self, key: str, program: bytes) -> None:
        """Keep a program."""
        path = self._path(key)
        content = zlib.compress(program, level=1)
        with contextlib.suppress(OSError):
            # A file appears under its name when it is whole; the temporary one is private.
            with tempfile.NamedTemporaryFile(dir=self._folder, suffix=".tmp", delete=False) as file:
                try:
                    file.write(_digest(path.name, content) + content)
                    file.close()
                    Path(file.name).replace(path)
                except OSError:
                    Path(file.name).unlink()
            self._make_room()

    def _path(self, key: str) -> Path:
        whole = f"{_source()}\n{_machine()}\n{key}"
        return self._folder / f"{hashlib.sha256(whole.encode()).hexdigest()}.program"

    def _make_room(self) -> None:
        """Remove the files, JAX's own among them, that were not used for longest."""
        files = [(path, path.stat()) for path in self._folder.iterdir()]
        left = self._most
        for path, facts in sorted(files, key=lambda file: -file[1].st_mtime):
            left -= facts.st_size
            if left < 0:
                path.unlink(missing_ok=True)


def _digest(name: str, content: bytes) -> bytes:
    return hashlib.sha256(name.encode() + content).digest()


def _made_private(folder: Path) -> bool:
    """Make a folder; whether it is one of this user's that no one else can use."""
    with contextlib.suppress(OSError):
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        facts = folder.lstat()
        own = stat.S_ISDIR(facts.st_mode) and _is_own(facts, others=0o077)
        return own and os.access(folder, os.W_OK | os.X_OK)
    return False


def _is_own(facts: os.stat_result, others: int = 0o022) -> bool:
    """Whether it is this user's, and no one else may write it (or what `others` says)."""
    if os.name == "nt":  # Which keeps the folders of users apart by itself.
        return True
    return facts.st_uid == os.geteuid() and not facts.st_mode & others


@functools.cache
def _source() -> str:
    """A digest of the package's version and source."""
    root = Path(niryo_jax.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(f"{path.relative_to(root)} ".encode() + path.read_bytes())
    return digest.hexdigest()


_TELLING = "vendor_id", "cpu family", "model", "model name", "stepping", "flags"
_TELLING_ARM = "Features", "CPU implementer", "CPU architecture", "CPU variant", "CPU part"


@functools.cache
def _machine() -> str:
    """The processor that programs are made for; where it does not say, this very computer."""
    said = list[str]()
    with contextlib.suppress(OSError):
        first = Path("/proc/cpuinfo").read_text(encoding="utf-8").split("\n\n")[0].splitlines()
        telling = {*_TELLING, *_TELLING_ARM}
        said = [line for line in first if line.split(":")[0].strip() in telling]
    return "\n".join(said) or repr(platform.uname())
