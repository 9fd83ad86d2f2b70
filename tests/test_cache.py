# SPDX-License-Identifier: MIT
"""The cache of compiled forms: whatever happens to it or to those who use it, what it gives is whole."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from filelock import FileLock

from tongue_fenicsx.cli.app import main
from tongue_fenicsx.core import cache
from tongue_fenicsx.core.errors import InputError


def make(folder: Path) -> None:
    (folder / "form.so").write_bytes(b"compiled")
    (folder / "form.c").touch()


def read(entry: Path) -> bytes:
    cache.provide(entry, make)
    return (entry / "form.so").read_bytes()


@pytest.fixture
def entry(tmp_path: Path) -> Path:
    return tmp_path / "cache" / "key"


def test_made_once(entry: Path) -> None:
    """What is there is not made again."""
    assert read(entry) == b"compiled"
    cache.provide(entry, lambda folder: pytest.fail("it is there"))


@pytest.mark.parametrize("damage", ["empty", "truncated", "changed", "missing", "unsealed", "lock of another tool"])
def test_damaged(entry: Path, damage: str) -> None:
    """An entry that is not as it was made is made again."""
    entry.mkdir(parents=True)
    if damage == "lock of another tool":
        (entry / "form.c").touch()
    else:
        cache.provide(entry, make)
        module = entry / "form.so"
        if damage in ("missing", "unsealed"):
            (module if damage == "missing" else entry / cache.SEAL).unlink()
        else:
            module.write_bytes({"empty": b"", "truncated": b"comp", "changed": b"\0" * 8}[damage])
    assert read(entry) == b"compiled"


def test_interrupted(entry: Path) -> None:
    """Nothing is left of what was interrupted."""

    def interrupt(folder: Path) -> None:
        make(folder)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cache.provide(entry, interrupt)
    assert [path.suffix for path in entry.parent.iterdir()] == [cache.LOCK]
    assert read(entry) == b"compiled"


USE = """
import os, sys, time
from pathlib import Path
from tongue_fenicsx.core import cache
def make(folder):
    print("made", flush=True)
    (folder / "form.so").write_bytes(b"compiled")
    {0}
cache.provide(Path(sys.argv[1]), make)
"""


def test_killed(entry: Path) -> None:
    """What a killed process left neither blocks nor stays."""
    code = USE.format(f"os.kill(os.getpid(), {int(signal.SIGKILL)})")
    assert subprocess.run([sys.executable, "-c", code, str(entry)], timeout=60).returncode == -signal.SIGKILL
    assert len(list(entry.parent.iterdir())) == 2
    assert read(entry) == b"compiled"
    assert {path.name for path in entry.parent.iterdir()} == {"key", "key.lock"}


def test_eight_processes(entry: Path) -> None:
    """One makes the entry, the others find it."""
    command = [sys.executable, "-c", USE.format("time.sleep(0.5)"), str(entry)]
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(8)]
    said = [process.communicate(timeout=120)[0] for process in processes]
    assert [process.returncode for process in processes] == [0] * 8
    assert sorted(said) == [""] * 7 + ["made\n"]


def test_a_folder_that_many_try_at_once(tmp_path: Path) -> None:
    """A folder counts as writable however many processes make sure of it in the same instant."""
    head = "import sys; from pathlib import Path; from tongue_fenicsx.core.errors import check_outputs"
    code = f"{head}\nfor _ in range(2000): check_outputs(Path(sys.argv[1]))"
    processes = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stderr=subprocess.PIPE, text=True) for _ in range(3)]
    assert [process.communicate(timeout=60)[1] for process in processes] == [""] * 3


def test_waiting_says_so(entry: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Whoever waits for another says for what."""
    entry.parent.mkdir()
    with ThreadPoolExecutor(1) as pool, FileLock(f"{entry}.lock"), caplog.at_level(logging.WARNING):
        waiting = pool.submit(read, entry)
        while not caplog.messages:
            assert not waiting.done()
    assert waiting.result() == b"compiled"
    assert caplog.messages == [f"waiting for another process, which makes the same into {entry.parent}"]


def test_threads(entry: Path) -> None:
    """Threads of one process share it, too."""
    made: list[Path] = []
    together = threading.Barrier(4)

    def use() -> None:
        together.wait()
        cache.provide(entry, lambda folder: made.append(folder) or make(folder))  # type: ignore[func-returns-value]

    with ThreadPoolExecutor(4) as pool:
        for use_of_one in [pool.submit(use) for _ in range(4)]:
            use_of_one.result()
    assert len(made) == 1


@pytest.mark.parametrize("given", ["", "relative"])
def test_default_place(given: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """XDG_CACHE_HOME counts where it is an absolute path."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", given)
    assert cache.open_cache("now") == tmp_path / ".cache" / "tongue_fenicsx" / "now"


def test_a_place_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """A file, a folder that cannot be made, no home: a temporary folder, which one line says; without that, one sentence."""
    (tmp_path / "file").touch()
    for place in (tmp_path / "file", Path("/proc/nope")):
        monkeypatch.setenv("XDG_CACHE_HOME", str(place))
        caplog.clear()
        folder = cache.open_cache("now")
        assert cache.open_cache("now") == folder
        assert folder.parent == Path(tempfile.gettempdir())
        assert len(caplog.messages) == 1
        assert f"{place}/tongue_fenicsx/now: cannot be written" in caplog.messages[0]
    cache._temporary.cache_clear()
    monkeypatch.setattr(tempfile, "tempdir", "/proc/nope")
    with pytest.raises(InputError, match="set TMPDIR, too"):
        cache.open_cache("now")


def test_without_a_home(tmp_path: Path) -> None:
    """A user whom the system does not know has no home: DOLFINx can be imported all the same, and the temporary cache goes at the end."""
    code = f"""
import os, pwd, tempfile
def unknown(uid):
    raise KeyError(uid)
pwd.getpwuid = unknown
tempfile.tempdir = {str(tmp_path)!r}
import tongue_fenicsx
from tongue_fenicsx.core import cache
from pathlib import Path
Path.home()
folder = cache.open_cache("now")
assert folder.parent == Path(tempfile.tempdir), folder
"""
    environment = {key: value for key, value in os.environ.items() if key not in ("HOME", "XDG_CACHE_HOME")}
    result = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60)
    assert result.returncode == 0, result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """`tongue cache` lists by DOLFINx and processor, and clears, but not what is being made."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def say(*arguments: str) -> str:
        with pytest.raises(SystemExit) as leaving:
            main(["cache", *arguments])
        assert leaving.value.code == 0
        return capsys.readouterr().out

    generation = cache.open_cache("0.11.0-abc")
    for name in ("one", "two"):
        cache.provide(generation / name, make)
    (generation / "libffcx_forms_abc.c").touch()
    assert "DOLFINx 0.11.0, processor abc: 2 forms, 0.0 MB" in say()
    with FileLock(generation / "two.lock"):
        assert "removed but for 1, which are being made" in say("--clear")
        assert {path.name for path in generation.iterdir()} == {"two", "two.lock"}
    assert say("--clear").endswith("removed\n")
    assert not generation.exists()
    distances = cache.open_cache(cache.DISTANCES)
    cache.provide(distances / "palate", make)
    assert "obstacles: 1 distances, 0.0 MB\n" in say("--clear", "--old")
    assert say("--clear").endswith("removed\n")
    assert not distances.exists()
