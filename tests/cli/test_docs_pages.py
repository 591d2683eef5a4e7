"""Run the commands, scenarios and Python of the documentation pages that its build does not execute.

The tutorials run when the documentation is built. These tests cover the how-to pages and the Python reference: their
commands run in a folder with the files they name, their TOML is read and run, and the gallery shows what ships.
"""

import json
import re
import shlex
import tomllib

import pytest
from PIL import Image

import dembrick
from dembrick import cli
from dembrick.runs.study import plan
from dembrick.scenario import shipped, toml
from dembrick.simulation import interrupts
from helpers import cad_files
from helpers.places import ROOT, tool_module

DOCS = ROOT / "docs"
HOWTO = sorted((DOCS / "howto").glob("*.md"))
PAGES = sorted(path for path in DOCS.rglob("*.md") if "_build" not in path.parts)
EXECUTED = {path for path in PAGES if "file_format: mystnb" in path.read_text(encoding="utf-8")}
STUDY = 'base = "set4a"\n[grid]\n"joint.friction" = [0.5, 0.6]\n'


def blocks(path, language=None):
    """Code blocks of a page: fenced ones in ``language``, or those indented by four spaces."""
    text = path.read_text(encoding="utf-8")
    if language:
        return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    plain = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    found = re.findall(r"(?:^ {4}.*\n|^\n(?= {4}))+", plain, re.MULTILINE)
    return [re.sub(r"^ {4}", "", part, flags=re.MULTILINE).strip("\n") for part in found]


def commands(path):
    return [line for part in blocks(path) for line in part.splitlines() if line.startswith("dembrick ")]


def toml_parts(path):
    parts = [*blocks(path, "toml"), *(part for part in blocks(path) if not part.startswith("dembrick "))]
    return [(path, part.partition("\n\ndembrick ")[0]) for part in parts]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the files that the how-to pages name."""
    place = tmp_path_factory.mktemp("docs")
    small = ["output.rows=40", "output.frames=20", "output.checkpoint=0"]
    dembrick.simulate(dembrick.load("set4a_curve", small), place / "run.h5")
    dembrick.simulate("arch", place / "arch.h5")
    dembrick.simulate("newmark_pulse", place / "shaken.h5")
    for formulation in ("concave", "convex"):
        dembrick.simulate(dembrick.load("set4a", [f"joint.formulation={formulation}"]), place / f"{formulation}.h5")
    (place / "study.toml").write_text(STUDY)
    table = (ROOT / "scenarios" / "paper_experiments.csv").read_text()
    (place / "data.csv").write_text(table)
    short = dembrick.load("set4a_curve", [*small, "control.travel=5e-6", "control.rate=1e-4", "output.rows=200"])
    (place / "test.toml").write_text(dembrick.dumps(short))
    rows = dembrick.simulate(short).rows
    lines = [f"{u:.9g},{V:.9g}" for u, V in zip(rows["displacement"], rows["load"], strict=True)]
    (place / "curve.csv").write_text("\n".join(["displacement [m],force [N]", *lines]))
    return place


RUN = [(path.stem, command) for path in HOWTO for command in commands(path) if "--scheduler" not in command]


@pytest.mark.parametrize("page, command", RUN)
def test_commands_of_how_to_pages_run(page, command, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    words = shlex.split(command)[1:]
    if words[0] == "restart" and "--at" not in words:
        interrupted_run(monkeypatch)
    if words[:2] == ["plot", "results/study/table.csv"]:
        assert cli.main(["sweep", "study.toml", "--jobs", "1", "--quiet"]) == 0
        if "--over" in words:  # the study of that page needs ground motions that are not shipped
            words[words.index("--over") + 1], words[words.index("--answer") + 1] = "joint.friction", "V"
    if "--jobs" in words:
        words[words.index("--jobs") + 1] = "1"
    code = cli.main([*words, *(["--size", "160", "120"] if words[0] == "render" else []), "--quiet"])
    assert code == 0, capsys.readouterr().err


def interrupted_run(monkeypatch):
    """Leave an interrupted run as run.h5."""
    asked = []
    with monkeypatch.context() as patch:
        patch.setattr(interrupts, "requested", lambda: 2 if asked else asked.append(1))
        with pytest.raises(interrupts.Interrupted):
            small = ["output.checkpoint=0", "output.rows=40", "output.frames=20"]
            dembrick.simulate(dembrick.load("set4a_curve", small), "run.h5", force=True)


def test_there_are_commands_to_run():
    assert len(RUN) >= 8 and {page for page, _ in RUN} >= {
        "cluster",
        "fit",
        "paraview",
        "pictures",
        "restart",
        "search",
    }


PROSE = sorted({
    (path.stem, found) for path in PAGES for found in re.findall(r"`(dembrick [a-z][^`]*)`", path.read_text("utf-8"))
    if path not in EXECUTED or "howto" in path.parts
})  # fmt: skip


@pytest.fixture(scope="module")
def parser():
    return cli.full_parser()


@pytest.mark.parametrize("page, command", [*PROSE, *((p.stem, c) for p in HOWTO for c in commands(p))])
def test_every_command_that_is_named_exists_with_its_options(page, command, parser):
    words = shlex.split(command)[1:]
    assert words[0] in cli.VERBS, command
    if len(words) > 1:
        (choices,) = (action.choices for action in parser._actions if action.choices)
        known = {option for action in choices[words[0]]._actions for option in action.option_strings}
        assert {word for word in words if word.startswith("-")} <= known


BASES = {"fills": "arch_filled", "stages": "set4a", "ties": "arch"}


PARTS = [part for path in HOWTO for part in toml_parts(path) if "=" in part[1]]


@pytest.mark.parametrize("path, text", PARTS, ids=lambda value: getattr(value, "stem", "")[:30])
def test_scenarios_and_studies_of_how_to_pages_are_right(path, text, tmp_path, monkeypatch):
    """Studies can be planned, and parts of scenarios run within the scenario that they belong to."""
    monkeypatch.chdir(tmp_path)
    document = tomllib.loads(text)
    if "base" in document:
        shaken = 'control={kind="base-motion", direction=[1,0,0], duration=1, file="x.csv", quantity="acceleration"}'
        (tmp_path / "my_wall.toml").write_text(dembrick.dumps(dembrick.load("arch_shaken", [shaken])))
        (tmp_path / "study.toml").write_text(text)
        assert len(plan.load("study.toml")) == {"drum_column_pulse": 4, "arch": 1}.get(document["base"], 40)
        return
    cad_files.obj(tmp_path / "gate.obj")
    cad_files.binary_stl(tmp_path / "stone.stl", {"stone": ((400.0, -50.0, 0.0), (500.0, 50.0, 80.0))})
    base = tomllib.loads(shipped.find(BASES.get(path.stem, "set4a")).read_text(encoding="utf-8"))
    lists = {key: [*base.get(key, ()), *value] for key, value in document.items() if isinstance(value, list)}
    merged = toml._write(base | document | lists)
    (tmp_path / "scene.toml").write_text(merged)
    changes = []
    if "models" in document:
        changes = ["supports=['gate.ground']", 'control={kind="tilt", axis=[0,1,0]}', "loads=[]", "actuators=[]"]
        changes += ["blocks=[]", "joint.friction=0.9"]
    if "mesh" in text and "models" not in document:
        changes = ["supports=['stone']"]
    if document.get("control", {}).get("kind") == "pushover" and "stages" in document:
        changes += ["actuators=[]"]  # those of the base scenario, which no stage drives
    result = dembrick.simulate(toml.load("scene.toml", changes), record=False)
    assert result.status == (
        "completed" if path.stem == "rig" and "protocol" in text else result.scenario.control.ends_with
    )
    if "stages" in document:
        assert len(result.as_dict()["stages"]) == len(document["stages"])


@pytest.mark.parametrize("path", [p for p in PAGES if p not in EXECUTED and blocks(p, "python")], ids=lambda p: p.stem)
def test_python_blocks_run(path, folder, monkeypatch, capsys):
    """Each ``print`` line prints what the comment after it says, up to a colon."""
    monkeypatch.chdir(folder)
    if path.stem == "paraview":
        pytest.importorskip("pyvista")
        assert cli.main(["export", "run.h5", "--to", "run.vtkhdf", "--quiet", "--force"]) == 0
    for part in blocks(path, "python"):
        exec(part, {})
        said = re.findall(r"^print\(.*\)  # ([^:\n]*)", part, re.MULTILINE)
        assert [line for line in capsys.readouterr().out.splitlines() if line in said] == said


def test_the_reference_of_python_has_every_name():
    pages = tool_module("reference_pages")
    told = set(" ".join(pages.PYTHON.values()).split()) | set(pages.MODULES)
    assert told - set(pages.HELD) == set(dembrick.__all__) - {"__version__"} - set(pages.HELD)
    for module, names in pages.MODULES.items():
        for name in names.split():
            assert callable(getattr(getattr(dembrick, module), name)), f"{module}.{name}"
    assert "autofunction:: dembrick.simulate" in pages.python_names()


@pytest.mark.parametrize(
    "words, page",
    [
        ("earthquake", "tutorials/earthquake"),
        ("seismic", "tutorials/earthquake"),
        ("vault", "tutorials/arch"),
        ("backfill", "howto/fills"),
        ("tie rod", "howto/ties"),
        ("mortar", "theory/strengths"),
        ("convergence", "howto/error_bars"),
        ("troubleshooting", "faq"),
        ("3DEC", "comparison"),
        ("Jupyter", "tutorials/python"),
    ],
)
def test_a_search_for_a_word_of_the_field_finds_its_page(words, page):
    """The word is in the title or the keywords of the page, which the site's search covers besides the text."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    title = re.search(r"^# (.*)$", text, re.MULTILINE).group(1)
    keywords = re.search(r'^    keywords: "(.*)"$', text, re.MULTILINE)
    assert words.lower() in f"{title}, {keywords.group(1) if keywords else ''}".lower()


@pytest.mark.parametrize("path", [ROOT / "README.md", *PAGES], ids=lambda p: p.stem)
def test_links_lead_to_files_of_a_checkout(path):
    """No link leads to a page that only the site build makes, as it would be dead in a checkout."""
    made = {(DOCS / "reference" / name).resolve() for name in tool_module("reference_pages").makers()}
    if path.resolve() in made:
        return
    for link in re.findall(r"\]\((?!https?:|mailto:)([^)#\s]+)", path.read_text(encoding="utf-8")):
        target = (path.parent / link).resolve()
        assert target.exists() and target not in made, link


def test_the_gallery_shows_what_ships():
    entries = json.loads((DOCS / "gallery" / "gallery.json").read_text(encoding="utf-8"))
    long = tool_module("gallery").LONG
    assert list(entries) == [name for name in shipped.examples() if name not in long or name in entries]
    for name, entry in entries.items():
        assert (DOCS / "gallery" / f"{name.replace('/', '_')}.png").stat().st_size > 3000, name
        if entry["kind"] != "study":
            scenario = dembrick.load(name)
            assert (entry["title"], entry["kind"]) == (scenario.title, scenario.control.kind)
            assert entry["blocks"] == len(scenario.all_blocks)
        with Image.open(DOCS / "gallery" / f"{name.replace('/', '_')}.png") as picture:
            assert picture.mode in ("RGB", "RGBA"), f"{name}: a palette shows bands"
    pages = tool_module("reference_pages")
    page = pages.gallery_page(DOCS / "gallery")
    assert page.count("![") == len(entries)
    told = [name for names in pages.subjects().values() for name in names]
    assert sorted(told) == sorted(shipped.examples())  # each under one subject
    first = page.split("## ")[0]
    assert [name for name in told if f"![{name}]" in first] == sorted(pages.FIRST, key=told.index)


GALLERY = json.loads((DOCS / "gallery" / "gallery.json").read_text(encoding="utf-8"))
QUICK, BRIEF = 1.0, 30.0  # s: longest runs tested with every change, and among the slow tests


def _entries(low, high):
    return [n for n, one in GALLERY.items() if one["kind"] != "study" and low < one["seconds"] <= high]


@pytest.mark.parametrize(
    "name", [*_entries(0.0, QUICK), *(pytest.param(n, marks=pytest.mark.slow) for n in _entries(QUICK, BRIEF))]
)
def test_numbers_of_the_gallery_are_those_of_now(name):
    gallery, number = tool_module("gallery"), re.compile(r"-?\d+\.?\d*")
    result = dembrick.simulate(name, record=False)
    told, now = GALLERY[name]["number"], gallery.number_of(result.results, result.curve.unit)
    old, new = (float(number.search(text).group()) for text in (told, now))
    assert number.split(told)[0] == number.split(now)[0] and old == pytest.approx(new, rel=2e-5)
