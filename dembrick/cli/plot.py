"""``dembrick plot FILE.h5 ...``: figures of histories, and of studies (table.csv); PNG, SVG or PDF by the ending."""

from __future__ import annotations

from dembrick.cli.paths import add_force, default_output

KINDS = {
    "curve": "load over displacement, with the bracket",
    "path": "shear force against torsion of a joint, on its yield domain",
    "joint": "the plane of a joint in several stages: slip, torsion centre, friction",
    "points": "components of the displacement of the control points, with signs, under the load or over time",
    "energies": "energies over time",
    "unbalanced": "out-of-balance force over time",
    "layout": "plan of the blocks and actuators",
    "domain": "yield domains with the yield points of the histories",
    "spectrum": "response spectra of ground motions (CSV or .AT2 files instead of histories)",
}
DAMPING, STAGES = 0.05, 4
BELONGS = {  # options of some kinds only
    "lab": ("curve",),
    "component": ("points",),
    "joint": ("path", "joint"),
    "stages": ("joint",),
    "damping": ("spectrum",),
}
LAB_FORMAT = (
    "measured curve to draw as well (may be repeated): a CSV file whose first line names its columns with their "
    "units, such as 'displacement [mm],force [N]'; lines that begin with # are comments"
)


def add_arguments(parser) -> None:
    parser.add_argument(
        "histories", nargs="+", metavar="FILE.h5", help="history files, drawn in one figure, or table.csv of a study"
    )
    parser.add_argument(
        "--to", metavar="FILE", help="figure file (default: results/<first history>.png, with the kind in its name)"
    )
    parser.add_argument(
        "--kind", choices=KINDS, default="curve", help="; ".join(f"{name}: {text}" for name, text in KINDS.items())
    )
    parser.add_argument(
        "--label", action="append", metavar="TEXT", help="label of a history (repeat for each, in order)"
    )
    parser.add_argument("--lab", action="append", default=[], metavar="FILE.csv", help=LAB_FORMAT)
    parser.add_argument(
        "--joint",
        metavar="A/B",
        help="joint for the kinds path and joint, by its blocks (default: the one that failed)",
    )
    parser.add_argument(
        "--component",
        action="append",
        choices=["x", "y", "z", "length"],
        help="for points: only this component (may be repeated; default: those of x, y and z that move)",
    )
    parser.add_argument(
        "--over", action="append", default=[], metavar="KEY", help="for a study: only this key (may be repeated)"
    )
    parser.add_argument("--answer", metavar="COLUMN", help="for a study: column to draw (default: value or V)")
    parser.add_argument(
        "--damping", type=float, metavar="SHARE", help=f"for spectrum: share of critical damping (default: {DAMPING:g})"
    )
    add_force(parser)
    parser.add_argument("--stages", type=int, metavar="N", help=f"for joint: number of stages (default: {STAGES})")


def run(options, console) -> int:
    from pathlib import Path

    from dembrick.views import plot

    if options.kind == "spectrum":
        return _spectrum(options, console)
    if any(plot.is_study(path) for path in options.histories):
        return _study(options, console)
    from dembrick import history
    from dembrick.errors import ScenarioError

    if options.over or options.answer:
        raise ScenarioError("--over and --answer belong to the table of a study (table.csv), not to a history")
    if options.label and len(options.label) != len(options.histories):
        raise ScenarioError(
            f"--label: {len(options.label)} labels for {len(options.histories)} histories; give one for each"
        )
    for name, kinds in BELONGS.items():
        if getattr(options, name) and options.kind not in kinds:
            raise ScenarioError(f"--{name} belongs to --kind {' or '.join(kinds)}, not to {options.kind}")
    measured = [plot.read_measured(path) for path in options.lab]
    files = [history.read(path) for path in options.histories]
    labels, joint = options.label, options.joint
    figure = {
        "curve": lambda: plot.force_displacement(files, labels, measured=measured),
        "path": lambda: plot.load_path(files, labels, joint=joint),
        "joint": lambda: plot.joint_stages(files, labels, joint=joint, stages=options.stages or STAGES),
        "points": lambda: plot.control_points(files, labels, components=options.component),
        "energies": lambda: plot.energies(files, labels),
        "unbalanced": lambda: plot.unbalanced(files, labels),
        "layout": lambda: plot.layout(files),
        "domain": lambda: plot.domains(files),
    }[options.kind]()
    stem = Path(options.histories[0]).stem
    read = [path for file in files for path in file.sources]
    with history.product(options.kind, [file.scenario_text for file in files], [*read, *options.lab], options.force):
        name = f"{stem}.png" if options.kind == "curve" else f"{stem}_{options.kind}.png"
        path = options.to or default_output(name, history.is_ours)
        plot.save(figure, path)
    answer, lines = _misfits(files, plot.labelled(files, labels)[1], measured, console)
    console.result({"figure": path, **answer}, "\n".join([f"figure: {path}", *lines]))
    return 0


def _spectrum(options, console) -> int:
    """Draw the response spectra of records."""
    from pathlib import Path

    from dembrick import history
    from dembrick.views import plot

    figure = plot.spectra(options.histories, DAMPING if options.damping is None else options.damping)
    with history.product("spectrum", [], options.histories, options.force):
        path = options.to or default_output(f"{Path(options.histories[0]).stem}_spectrum.png", history.is_ours)
        plot.save(figure, path)
    console.result({"figure": path}, f"figure: {path}")
    return 0


def _misfits(histories, labels, measured, console) -> tuple[dict, list[str]]:
    """The misfits of all histories against all measured curves, as JSON and as lines."""
    from dembrick.errors import ScenarioError
    from dembrick.views import misfit, plot

    found, lines, springs, names = [], [], [], (*misfit.NUMBERS, "compared")
    for history, label in zip(histories, labels, strict=True):
        for curve in measured:
            ours = plot.record_of(history)
            try:
                one = misfit.between(ours, curve, curve.name)
            except ScenarioError as error:
                console.remark(f"no misfit: {error}")
                found.append({"history": history.path, "measured": curve.name, **dict.fromkeys(names)})
                continue
            found.append(
                {"history": history.path, "measured": curve.name, **one.numbers(), "compared": [*one.compared]}
            )
            whose = f" of {label} against {curve.name}" if len(histories) * len(measured) > 1 else ""
            lines.append(f"misfit{whose}: {misfit.text(one)}{misfit.extent(one, ours, curve)}")
            springs.append(misfit.turns_early(ours, curve) and not history.counts_equilibria)
    if any(springs):
        console.remark(
            "at a constant rate the spring of the jack takes a part of its travel; if displacements were measured on "
            "the block, run the test with control.large_displacements = true, which prescribes them"
        )
    answer = {"misfit": {name: found[0][name] for name in names}} if found else {}
    return answer | ({"misfits": found} if len(found) > 1 else {}), lines


def _study(options, console) -> int:
    """Draw the answers of a study over its keys."""
    from pathlib import Path

    from dembrick import history
    from dembrick.errors import ScenarioError
    from dembrick.views import plot

    if len(options.histories) > 1:
        raise ScenarioError("a study has a figure of its own: give one table.csv and no other file")
    if options.label or options.lab or options.joint or options.kind != "curve":
        raise ScenarioError(
            "--kind, --label, --lab and --joint belong to histories; for a study use --over and --answer"
        )
    table = plot.read_study(options.histories[0])
    figure = plot.study(table, options.answer, options.over)
    with history.product("study", [table.path], [table.path], options.force):
        name = Path(table.path).resolve().parent.name or "study"
        path = options.to or default_output(f"{name}.png", history.is_ours)
        plot.save(figure, path)
    console.result({"figure": path}, f"figure: {path}")
    return 0
