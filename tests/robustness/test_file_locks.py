"""File locks by the calls of POSIX and of Windows: who compiles a kernel, and who writes an index."""

import os
import subprocess
import sys

import pytest

from dembrick import _file_locks
from dembrick._kernel_cache import Claims
from helpers import windows_locks
from helpers.places import ROOT

BYTE = _file_locks.MOST - 3
OTHER = """
import sys, time; sys.path.insert(0, {tests!r})
from dembrick import _file_locks
from dembrick._kernel_cache import Claims
from helpers import windows_locks
if {windows}:
    _file_locks.fcntl, _file_locks.msvcrt = None, windows_locks
claims = Claims({path!r})
print([claims.take(byte) for byte in ({byte}, 7)], flush=True)
sys.stdin.readline()
claims.let_go(7)
print("let go", flush=True)
time.sleep(60)
"""


@pytest.fixture(params=["posix", "windows"])
def other(request, monkeypatch, tmp_path):
    """A process that has claimed two bytes, with the kind of locks that this process uses."""
    windows = request.param == "windows"
    if windows and sys.platform != "linux":
        pytest.skip("locks of Windows are played by those of Linux")
    if windows:
        monkeypatch.setattr(_file_locks, "fcntl", None)
        monkeypatch.setattr(_file_locks, "msvcrt", windows_locks)
    code = OTHER.format(tests=str(ROOT / "tests"), windows=windows, path=str(tmp_path / ".claims"), byte=BYTE)
    process = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "[True, True]\n"
    yield process
    process.kill()
    process.wait()


def test_a_claim_is_one_process_s_until_it_lets_go_or_dies(other, tmp_path):
    claims = Claims(tmp_path / ".claims")
    assert not claims.take(BYTE) and not claims.take(7)
    assert claims.take(8) and claims.take(8)  # its own claim, twice
    other.stdin.write("\n")
    other.stdin.flush()
    assert other.stdout.readline() == "let go\n"
    assert claims.take(7) and not claims.take(BYTE)
    other.kill()
    other.wait()
    assert claims.take(BYTE)
    claims.let_go(BYTE)
    claims.let_go(BYTE)  # a byte that nobody has claimed
    assert Claims(tmp_path / ".claims").take(BYTE)


def test_without_locks_everybody_may_compile(monkeypatch, tmp_path):
    monkeypatch.setattr(_file_locks, "fcntl", None)
    monkeypatch.setattr(_file_locks, "msvcrt", None)
    assert not _file_locks.known()
    assert Claims(tmp_path / ".claims").take(1) and not os.path.exists(tmp_path / ".claims")
    assert Claims(tmp_path / "no" / ".claims").take(1)


def test_a_disk_without_locks_and_a_folder_that_is_gone_stop_nobody(monkeypatch, tmp_path):
    assert Claims(tmp_path / "no" / ".claims").take(1)

    def refuse(*_):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(_file_locks, "lock_byte", refuse)
    assert Claims(tmp_path / ".claims").take(1)
