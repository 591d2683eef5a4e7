"""The command line: one module a verb, imported only when that verb runs."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module

from dembrick import __version__
from dembrick.errors import DembrickError

VERBS = {
    "lab": "replay the four laboratory tests for all formulations and print Table 3",
    "run": "run a scenario",
    "check": "validate and describe a scenario without running it",
    "domain": "yield domain of a joint by theory, and by simulation",
    "yield": "yield points out of histories",
    "plot": "force-displacement curves of histories",
    "export": "a history for ParaView (.vtkhdf, .pvd) or as text (.csv)",
    "render": "a picture of a history",
    "info": "what a history holds",
    "warmup": "compile the kernels into the cache",
}


def _module(verb: str):
    return import_module(f"dembrick.cli.{verb}_" if verb in ("yield",) else f"dembrick.cli.{verb}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="dembrick",
        description="Replays laboratory tests of dry-stacked stone blocks, with an error bar on every number.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="commands:\n"
        + "\n".join(f"  {verb:8} {text}" for verb, text in VERBS.items())
        + "\n\n'dembrick COMMAND --help' tells the options of a command.",
    )
    parser.add_argument("--version", action="version", version=f"dembrick {__version__}")
    parser.add_argument("command", choices=VERBS, metavar="COMMAND", help="one of the commands below")
    parser.add_argument("rest", nargs=argparse.REMAINDER, metavar="...", help="its arguments")
    return parser


def _verb_parser(verb: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=f"dembrick {verb}", description=f"{VERBS[verb][0].upper()}{VERBS[verb][1:]}.")
    common = parser.add_argument_group("output")
    common.add_argument("--json", action="store_true", help="print one JSON object on standard output")
    common.add_argument("--quiet", "-q", action="store_true", help="no progress and no remarks")
    common.add_argument("-v", "--verbose", action="store_true", help="more remarks, on standard error")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 ok, 1 no answer, 2 invalid input, 3 off theory, 4 missing)."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if not arguments:
        _parser().print_help()
        return 2
    args = _parser().parse_args(arguments)
    module = _module(args.command)
    parser = _verb_parser(args.command)
    module.add_arguments(parser)
    options = parser.parse_args(args.rest)
    from dembrick.cli.console import Console

    console = Console(json=options.json, quiet=options.quiet, verbose=options.verbose)
    try:
        return module.run(options, console)
    except DembrickError as error:
        console.error(str(error))
        if options.json and hasattr(error, "as_json"):
            console.result(error.as_json, "")
        return error.exit_code
    except KeyboardInterrupt:
        console.error("interrupted; what was simulated is on disk where a history was asked for")
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 0
