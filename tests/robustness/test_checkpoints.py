"""Checkpoints that are damaged, strange or from another run, and disks that are full."""

import json
import os
import random
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest

from dembrick.errors import HistoryError, WriteError
from dembrick.history import Checkpoint, Checkpoints, read
from dembrick.kernels.statics.lone_joint import SEARCH
from dembrick.runs.simulate import restart, simulate
from helpers.restart_cases import case, check_same, content, rewritten, stop_at_look


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    """Folder of an uninterrupted run, and of the same one stopped after three equilibria, with its two checkpoints."""
    folder, given = tmp_path_factory.mktemp("once"), case("set4a", "concave")
    simulate(given, folder / "whole.h5")
    stop_at_look(given, folder / "run.h5", 4)
    return folder


@pytest.fixture
def stopped(tmp_path, once):
    """The stopped run in a folder of its own, see `once`."""
    return shutil.copytree(once, tmp_path, dirs_exist_ok=True) / "run.h5"


def by_step(path):
    """The two checkpoint files, the newer last."""
    return sorted(Checkpoints(path).existing(), key=lambda one: Checkpoint(one).about["number"])


def test_the_newest_checkpoint_is_the_last_that_was_saved(tmp_path):
    """Whichever of the two files holds it; no step is repeated."""
    kept = Checkpoints(tmp_path / "run.h5")
    known = {"scenario": "", "kernels": "", "rows": 0, "frames": 0}
    for step in range(1, 4):
        kept.save({"V": np.array([float(step)])}, {"run": "one", "where": f"step {step}"} | known)
        found, faults = Checkpoints(tmp_path / "run.h5").newest("one")
        assert found.about["where"] == f"step {step}" and not faults


def test_the_other_checkpoint_serves_where_the_newest_is_damaged(stopped, capsys):
    older, newest = by_step(stopped)
    assert [Checkpoint(one).about["number"] for one in (older, newest)] == [3, 4]
    whole = Path(newest).read_bytes()
    Path(newest).write_bytes(whole[: len(whole) // 2])
    restart(stopped, report=print)
    assert "equilibrium 2" in capsys.readouterr().out
    check_same(stopped.parent / "whole.h5", stopped)


def test_a_flipped_bit_is_noticed(stopped):
    """A flipped bit anywhere in the numbers: the checksums of the archive detect it."""
    _, newest = by_step(stopped)
    whole = Path(newest).read_bytes()
    with zipfile.ZipFile(newest) as archive:
        entry = archive.getinfo("state.blocks.velocity.npy")
        at = entry.header_offset + len(whole[entry.header_offset :].split(b"}")[0]) + 60
    rng, noticed = random.Random(1), 0
    for place in [at, *(rng.randrange(len(whole)) for _ in range(60))]:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << rng.randrange(8)
        Path(newest).write_bytes(damaged)
        try:
            checkpoint = Checkpoint(newest)
            for name in ("state.blocks.velocity", "loop"):
                checkpoint.array(name, np.zeros((2, 3)) if "." in name else np.zeros(2))
        except HistoryError as error:
            assert newest in str(error) and "\n" not in str(error)
            noticed += 1
            if place == at:
                first = noticed
    assert first == 1 and noticed > 45  # the others hit dates and names in the archive, which are never read


def about(path, **changes):
    found = {**Checkpoint(path).about, **changes}
    return np.frombuffer(json.dumps(found).encode(), np.uint8)


def searched(path, name, number):
    """The checkpoint with one number of its search replaced, see `SEARCH`."""

    def changed(search):
        search[SEARCH.names.index(name)] = number
        return search

    rewritten(path, **{"lone.search": changed})


STRANGE = {
    "of another shape": lambda one: rewritten(one, **{"state.blocks.velocity": np.zeros((3, 3))}),
    "of another type": lambda one: rewritten(one, **{"state.blocks.velocity": np.zeros((2, 3), np.float32)}),
    "missing": lambda one: rewritten(one, **{"state.blocks.velocity": None}),
    "an object": lambda one: rewritten(one, **{"state.blocks.velocity": np.array([{}], object)}),
    "an index that leads elsewhere": lambda one: rewritten(one, **{"state.points.start": np.array([0, 10**6])}),
    "a joint of nothing": lambda one: rewritten(one, **{"state.joints.block_a": np.array([7])}),
    "in other axes order": lambda one: rewritten(one, **{"state.blocks.velocity": np.asfortranarray(np.ones((2, 3)))}),
    "of an equilibrium before the first": lambda one: searched(one, "equilibria", -5.0),
    "of half an equilibrium": lambda one: searched(one, "equilibria", 2.5),
    "of no equilibrium": lambda one: searched(one, "equilibria", np.nan),
    "of no step": lambda one: searched(one, "step", np.nan),
    "of another end": lambda one: searched(one, "status", 2.0),
    "of another run": lambda one: rewritten(one, about=about(one, run="0123456789abcdef")),
    "of another scenario": lambda one: rewritten(one, about=about(one, scenario="0" * 64)),
    "of another version": lambda one: rewritten(one, about=about(one, kernels="0" * 16)),
    "of a newer format": lambda one: rewritten(one, about=about(one, format=99)),
    "without counts": lambda one: rewritten(one, about=about(one, rows="many")),
    "with absurd counts": lambda one: rewritten(one, about=about(one, rows=10**15)),
    "with negative counts": lambda one: rewritten(one, about=about(one, frames=-1)),
    "a list": lambda one: rewritten(one, about=np.frombuffer(b"[1]", np.uint8)),
    "no JSON": lambda one: rewritten(one, about=np.frombuffer(b"{", np.uint8)),
    "deep": lambda one: rewritten(one, about=np.frombuffer(b"[" * 100_000, np.uint8)),
    "empty": lambda one: Path(one).write_bytes(b""),
    "text": lambda one: Path(one).write_text("hello"),
    "compressed": lambda one: np.savez_compressed(one + ".npz", zeros=np.zeros(10**6)) or os.replace(one + ".npz", one),
    "a folder": lambda one: (os.unlink(one), os.mkdir(one)),
    "a header without end": lambda one: bare(one, b"\x93NUMPY\x01\x00\xff\xff" + b"(" * 65535),
    "an absurd shape": lambda one: bare(
        one, npy_header("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000000, 3), }")
    ),
    "a call in the header": lambda one: bare(one, npy_header("__import__('os').getcwd()")),
}


def npy_header(text):
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def bare(path, raw):
    """Replace one array of the archive by raw bytes."""
    with zipfile.ZipFile(path) as found:
        entries = {name: found.read(name) for name in found.namelist()}
    entries["state.blocks.velocity.npy"] = raw
    with zipfile.ZipFile(path, "w") as out:
        for name, content in entries.items():
            out.writestr(name, content)


@pytest.mark.parametrize("edit", STRANGE.values(), ids=STRANGE)
def test_a_strange_checkpoint_gives_one_sentence_and_leaves_the_history_alone(stopped, edit):
    for one in by_step(stopped):
        edit(one)
    before = content(stopped)
    with pytest.raises(HistoryError) as caught:
        restart(stopped)
    message = str(caught.value)
    assert str(stopped) in message and "\n" not in message and len(message) < 400 + 2 * len(str(stopped))
    after = content(stopped)
    assert after["history/load"].tobytes() == before["history/load"].tobytes()


def test_a_history_with_fewer_rows_than_its_checkpoint_is_refused(stopped):
    for one in by_step(stopped):
        rewritten(one, about=about(one, rows=50))
    with pytest.raises(HistoryError, match="the run had written 50"):
        restart(stopped)


def test_a_run_that_is_over_is_not_restarted(tmp_path):
    simulate(case("set4a", "concave"), tmp_path / "run.h5")
    with pytest.raises(HistoryError, match=r"this run has ended \(status yield\)"):
        restart(tmp_path / "run.h5")


def test_checkpoints_of_an_earlier_run_are_not_taken(tmp_path, stopped):
    """A new run with the same file name does not continue from the checkpoints of an earlier one."""
    left = [Path(one).read_bytes() for one in Checkpoints(stopped).paths]
    with pytest.raises(KeyboardInterrupt):
        interrupted_at_once(case("set4b", "concave"), stopped)
    for one, content_before in zip(Checkpoints(stopped).paths, left, strict=True):
        Path(one).write_bytes(content_before)
    with pytest.raises(HistoryError, match="another run"):
        restart(stopped)


def interrupted_at_once(given, path):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "dembrick.runs.drivers.limit_load.find_limit_load",
            lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt),
        )
        simulate(given, path, force=True)


def test_a_disk_that_fills_up_leaves_something_to_go_on_with(tmp_path, stop_after, monkeypatch):
    """The history can no longer be written: exit code 1; once there is room again, the run can be continued."""
    given = case("set4a", "concave")
    simulate(given, tmp_path / "whole.h5")
    path = tmp_path / "run.h5"
    from dembrick.history import layout

    put, calls = layout.put, []

    def full(*args):
        calls.append(1)
        if len(calls) > 60:
            raise OSError(28, "No space left on device")
        put(*args)

    monkeypatch.setattr(layout, "put", full)
    with pytest.raises(WriteError, match=f"No space left on device.*dembrick restart {path}") as caught:
        simulate(given, path)
    assert caught.value.answer["status"] == "failed" and caught.value.exit_code == 1
    monkeypatch.setattr(layout, "put", put)
    with read(path) as file:
        assert file.status == "running" and file.n_row > 0
    restart(path)
    check_same(tmp_path / "whole.h5", path)


def test_a_checkpoint_that_cannot_be_written_ends_the_run_and_keeps_the_one_before(tmp_path, stop_after, monkeypatch):
    given = case("set4a", "concave")
    simulate(given, tmp_path / "whole.h5")
    savez, calls = np.savez, []

    def full(file, **arrays):
        calls.append(1)
        if len(calls) > 5:
            file.write(b"half of it")
            raise OSError(28, "No space left on device")
        savez(file, **arrays)

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(WriteError, match="the checkpoint could not be written .No space left"):
        simulate(given, tmp_path / "run.h5")
    monkeypatch.setattr(np, "savez", savez)
    assert [Checkpoint(one).about["number"] for one in by_step(tmp_path / "run.h5")] == [4, 5]
    restart(tmp_path / "run.h5")
    check_same(tmp_path / "whole.h5", tmp_path / "run.h5")
