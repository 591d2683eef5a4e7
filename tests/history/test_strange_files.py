"""Files that no run of ours wrote, or that were cut or changed: one sentence each, and no content is trusted."""

import os
import random

import h5py
import numpy as np
import pytest

from dembrick import history
from dembrick.errors import HistoryError
from dembrick.simulation.channels import CHANNELS, FRAMES, JOINT_CHANNELS
from helpers import history_cases as cases

FRAME_CHANNELS = [channel.path.removeprefix("frames/") for channel in CHANNELS if channel.grows_by == FRAMES]


def test_a_cut_file_is_refused_at_every_length(tmp_path):
    whole = cases.finished(tmp_path / "run.h5").read_bytes()
    cut = tmp_path / "cut.h5"
    for length in [0, 1, 7, 8, 100, *range(1000, len(whole), 4999), len(whole) - 1]:
        cut.write_bytes(whole[:length])
        with pytest.raises(HistoryError) as caught:
            history.read(cut)
        assert str(cut) in str(caught.value) and "\n" not in str(caught.value)


def test_a_file_that_is_replaced_while_it_is_read(tmp_path):
    """A run replaces the file; a reader that has the old one open continues to read it."""
    path = cases.finished(tmp_path / "run.h5")
    with history.read(path) as found:
        (tmp_path / "other").write_bytes(b"short")
        os.replace(tmp_path / "other", path)
        assert len(found.block_names) == found.n_block == 2
        assert found.position0.shape == (2, 3)


def read_all(path):
    """Read everything that a history offers."""
    with history.read(path) as found:
        for name in dir(type(found)):
            if not name.startswith("_"):
                getattr(found, name)
        for name in JOINT_CHANNELS:
            found.joint(name)
        for i in range(found.n_block):
            found.block_vertices(i), found.block_faces(i)
        for k in range(found.n_frames):
            for name in FRAME_CHANNELS:
                found.frame(name, k)
            found.frame_new_contacts(k, k + 1)


def replaced(name, make):
    """An edit of the file that replaces a dataset."""

    def edit(file, folder):
        del file[name]
        make(file, name, folder)

    return edit


def outside(folder):
    """A file that must not be read: numbers enough for another history."""
    with h5py.File(folder / "outside.h5", "w") as other:
        other["secret"] = np.arange(20.0)
    np.arange(20.0).tofile(folder / "outside.raw")
    return folder


def external_storage(file, name, folder):
    how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    how.set_external(os.fsencode(outside(folder) / "outside.raw"), 0, 160)
    h5py.h5d.create(file.id, name.encode(), h5py.h5t.IEEE_F64LE, h5py.h5s.create_simple((20,)), how)


def virtual(file, name, folder):
    source = h5py.VirtualLayout((20,), float)
    source[:] = h5py.VirtualSource(outside(folder) / "outside.h5", "secret", (20,))
    file.create_virtual_dataset(name, source)


def soft(file, name, _folder):
    file[name] = h5py.SoftLink("/history/time")


def external(file, name, folder):
    file[name] = h5py.ExternalLink(str(outside(folder) / "outside.h5"), "secret")


def put(value, **options):
    return lambda file, name, _folder: file.create_dataset(name, data=value, **options)


def absurd(shape, **options):
    return lambda file, name, _folder: file.create_dataset(name, shape, float, **options)


def set_attribute(name, value):
    return lambda file, _folder: file.attrs.__setitem__(name, value)


STRANGE = {
    "not ours": lambda file, _: file.attrs.clear(),
    "newer": set_attribute("format", 99),
    "format as text": set_attribute("format", "one"),
    "format as a list": set_attribute("format", [1, 2]),
    "status as number": set_attribute("status", 3),
    "status empty": set_attribute("status", h5py.Empty("f8")),
    "results not JSON": set_attribute("results", "{"),
    "results a list": set_attribute("results", "[1]"),
    "results deep": set_attribute("results", "[" * 100_000),
    "settings a number": set_attribute("settings", 5),
    "soft link": replaced("history/load", soft),
    "external link": replaced("history/load", external),
    "external group": replaced("history/joint", external),
    "external frames": replaced("frames", external),
    "external storage": replaced("history/load", external_storage),
    "virtual": replaced("history/load", virtual),
    "external scenario": replaced("scenario", external),
    "external vertices": replaced("geometry/blocks/vertices", external),
    "missing": replaced("history/load", lambda *_: None),
    "missing group": replaced("geometry", lambda *_: None),
    "group for dataset": replaced("history/load", lambda file, name, _: file.create_group(name)),
    "dataset for group": replaced("history/joint", put(np.zeros(3))),
    "short": replaced("history/load", put(np.zeros(19))),
    "too many axes": replaced("history/load", put(np.zeros((20, 2)))),
    "wrong width": replaced("history/joint/N", put(np.zeros((20, 2)))),
    "text": replaced("history/load", put(["a"] * 20)),
    "compound": replaced("history/load", put(np.zeros(20, [("a", "f8"), ("b", "f8")]))),
    "absurd length": replaced("history/load", absurd((10**15,), chunks=(1024,))),
    "absurd width": replaced("frames/position", absurd((4, 10**9, 3), chunks=(1, 1024, 3))),
    "absurd blocks": replaced("geometry/blocks/vertices", absurd((10**15, 3), chunks=(1024, 3))),
    "foreign filter": replaced("history/load", put(np.zeros(20), compression="lzf", chunks=(20,))),
    "written negative": lambda file, _: file["written"].__setitem__(0, -1),
    "written beyond": lambda file, _: file["written"].__setitem__(0, 21),
    "written frames": lambda file, _: file["written"].__setitem__(1, 2**62),
    "written scalar": replaced("written", put(4)),
    "scenario as number": replaced("scenario", put(4)),
    "face beyond": lambda file, _: file["geometry/blocks/corner"].__setitem__(3, 8),
    "face negative": lambda file, _: file["geometry/blocks/corner"].__setitem__(3, -1),
    "starts backwards": lambda file, _: file["geometry/blocks/vertex_start"].__setitem__(1, 17),
    "no faces": replaced("geometry/blocks/corner_start", put(np.zeros(0, int))),
    "not a number": lambda file, _: file["geometry/blocks/position"].__setitem__((0, 0), np.nan),
    "joint of nothing": lambda file, _: file["geometry/joints/blocks"].__setitem__((0, 0), 7),
    "jack on nothing": lambda file, _: file["geometry/actuators/block"].__setitem__(0, 2),
    "control point on nothing": lambda file, _: file["geometry/control_points/block"].__setitem__(0, -1),
    "control points without names": lambda file, _: file.__delitem__("geometry/control_points/name"),
    "contacts too short": replaced("frames/contact_force", put(np.zeros((4, 3, 3)))),
    "absurd contacts": replaced("geometry/joints/point", absurd((10**15, 5), chunks=(1024, 5))),
    "absurd velocity": replaced("frames/velocity", absurd((10**12, 2, 3), chunks=(64, 2, 3))),
    "external spin": replaced("frames/spin", external),
    "soft contacts": replaced("frames/contact_force", soft),
    "shift of another shape": replaced("frames/joint_shift", put(np.zeros((4, 1)))),
    "arms too short": replaced("frames/contact_arm", put(np.zeros((4, 3, 2)))),
    "new contacts backwards": lambda file, _: file["frames/new_contacts/end"].__setitem__(1, 5),
    "new contacts negative": lambda file, _: file["frames/new_contacts/end"].__setitem__(0, -1),
    "new contacts beyond": lambda file, _: file["frames/new_contacts/end"].__setitem__(3, 7),
    "new contacts without end": lambda file, _: file.__delitem__("frames/new_contacts/end"),
    "new contacts between nothing": lambda file, _: file["frames/new_contacts/blocks"].__setitem__((0, 1), 2),
    "new contacts in part": lambda file, _: file.__delitem__("frames/new_contacts/torque"),
    "soft new contacts": replaced("frames/new_contacts", soft),
    "external new contacts": replaced("frames/new_contacts/force", external),
    "absurd new contacts": replaced("frames/new_contacts/point", absurd((10**12, 3), chunks=(64, 3))),
    "ends as numbers": replaced("frames/new_contacts/end", put(np.zeros(4))),
    "external mass": replaced("geometry/blocks/mass", external),
    "inertia of another shape": replaced("geometry/blocks/inertia", put(np.zeros((2, 3)))),
    "mass not a number": lambda file, _: file["geometry/blocks/mass"].__setitem__(1, np.nan),
    "names as bytes": replaced("geometry/blocks/name", put(np.array([b"\xff", b"\xfe"]))),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The bytes of a history that reads well."""
    path = cases.finished(tmp_path_factory.mktemp("whole") / "run.h5", in_real_time=True)
    read_all(path)
    return path.read_bytes()


@pytest.mark.parametrize("edit", STRANGE.values(), ids=STRANGE)
def test_a_strange_file_gives_one_sentence(tmp_path, whole, edit):
    path = tmp_path / "run.h5"
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        edit(file, tmp_path)
    with pytest.raises(HistoryError) as caught:
        read_all(path)
    message = str(caught.value)
    assert str(path) in message and "\n" not in message and len(message) < 300 + len(str(path))


def test_flipped_bytes_never_give_another_error(tmp_path, whole):
    """Random damage either raises our own error or changes only numbers, which then read as other numbers."""
    rng = random.Random(3)
    bad, noticed = tmp_path / "bad.h5", 0
    for _ in range(150):
        damaged = bytearray(whole)
        for _ in range(rng.randint(1, 20)):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        bad.write_bytes(damaged)
        try:
            read_all(bad)
        except HistoryError:
            noticed += 1
    print(f"noticed {noticed} of 150")
    assert noticed > 10


def test_a_damaged_heap_of_texts_is_not_walked_for_ever(tmp_path):
    """HDF5 itself may never return from one."""
    whole = cases.finished(tmp_path / "run.h5").read_bytes()
    length = b"\5" + 7 * b"\0"
    name = whole.index(length + b"lower\0") + len(length)  # of a block
    heap = whole.rindex(b"GCOL", 0, name)
    for place, value in ((name - 7, 145), (name - 6, 1), (name - 1, 128), (heap + 10, 255)):
        damaged = bytearray(whole)
        damaged[place] = value
        (tmp_path / "bad.h5").write_bytes(damaged)
        with pytest.raises(HistoryError, match="its texts cannot be read"):
            history.read(tmp_path / "bad.h5")


def test_other_things_than_files(tmp_path):
    (tmp_path / "note.h5").write_text("hello")
    for name, words in (("nothing.h5", "no such file"), (".", "not a file"), ("note.h5", "not an HDF5 file")):
        with pytest.raises(HistoryError, match=words):
            history.read(tmp_path / name)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(HistoryError, match="not a file"):
        history.read(tmp_path / "pipe")
