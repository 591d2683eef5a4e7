"""The command line: one module per command, imported only when that command runs.

A module has `add_arguments(parser)`, the options of its command, and `run(options, console)`, which returns the exit
code. The command name is read without argparse, so ``dembrick --help`` takes little longer than starting Python.
"""

from __future__ import annotations

import atexit
import gc
import sys
from collections.abc import Iterable
from contextlib import contextmanager

from dembrick import __version__
from dembrick.cli.streams import mute, open_closed, print_error, print_output
from dembrick.errors import DembrickError

GARBAGE = 400_000  # new objects before a garbage collection: imports and loading of kernels leave no garbage
VERBS = {
    "lab": "replay the four laboratory tests for all formulations and print Table 3",
    "run": "run a scenario",
    "new": "write a complete, commented scenario to start from",
    "examples": "list, print or copy the scenarios that ship with the package",
    "check": "validate and describe a scenario without running it",
    "limit": "rigid-block limit analysis: bounds on the load factor, the mechanism, reactions",
    "domain": "yield domain of a joint, by theory and by simulation",
    "sweep": "run a parameter study: grid, table or random draws, on all cores or a cluster",
    "fit": "fit friction to measured yield points, or scenario keys to measured curves",
    "yield": "list the yield points of histories",
    "joints": "list the forces of every joint: N, V, M_T, eccentricity, slip, utilisation",
    "plot": "draw figures of histories and studies, such as force-displacement curves",
    "export": "write a history as ParaView, CSV, picture, curve or page, chosen by the ending",
    "render": "draw a picture, movie or web page of a history",
    "view": "open a window on a history, with a time slider",
    "restart": "continue a run that was killed or interrupted",
    "info": "summarise a history",
    "verify": "run the verification cases that ship with the package against their references",
    "completion": "shell completion for bash, zsh, tcsh and fish",
    "schema": "print the JSON schema of a scenario, for editors",
    "warmup": "compile the kernels into the cache",
}
SIMULATING = ("domain", "fit", "lab", "restart", "run", "sweep", "verify", "warmup")  # these may compile kernels
HELP = (
    "usage: dembrick COMMAND ...\n\n"
    "Replays laboratory tests of dry-stacked stone blocks, with an error bar on every number.\n\ncommands:\n"
    + "".join(f"  {verb:10} {text}\n" for verb, text in VERBS.items())
    + "\n'dembrick COMMAND --help' lists the options of a command, 'dembrick --version' prints the version,"
    + "\nand with -v also where the compiled kernels come from."
)


def _module(verb: str):
    from importlib import import_module

    return import_module(f"dembrick.cli.{verb}_" if verb == "yield" else f"dembrick.cli.{verb}")


def full_parser():
    """The parser of all commands at once, for shell completion and for the reference pages."""
    import argparse

    parser = argparse.ArgumentParser(
        prog="dembrick", description="Replays laboratory tests of dry-stacked stone blocks."
    )
    parser.add_argument("--version", action="store_true", help="print the version")
    commands = parser.add_subparsers(metavar="COMMAND")
    for verb, text in VERBS.items():
        _add_arguments(commands.add_parser(verb, help=text), verb)
    return parser


def _add_arguments(parser, verb: str) -> None:
    """Add the options common to all commands, and those of ``verb``."""
    parser.description = f"{VERBS[verb][0].upper()}{VERBS[verb][1:]}."
    common = parser.add_argument_group("output")
    common.add_argument("--json", action="store_true", help="print one JSON object on standard output")
    common.add_argument("--quiet", "-q", action="store_true", help="print no progress and no remarks")
    common.add_argument(
        "-v", "--verbose", action="store_true", help="print where the time of a run went, on standard error"
    )
    _module(verb).add_arguments(parser)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit code (0 ok, 1 no answer, 2 invalid input, 3 differs from theory, 4 missing
    dependency, 130/143 interrupted)."""
    open_closed()
    try:
        return _main(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        print_error("interrupted")
        return 130
    except BrokenPipeError:  # the reader of the output has closed the pipe
        mute(sys.stdout)
        return 0
    except DembrickError as error:
        print_error(f"error: {error}")
        return error.exit_code
    finally:
        try:
            sys.stdout.flush()  # here, as errors at the exit of Python cannot be caught
        except (OSError, ValueError):
            mute(sys.stdout)


def _main(arguments: list[str]) -> int:
    """Run the command line; `main` flushes the output and handles errors."""
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print_output(HELP)
        return 0 if arguments else 2
    verb, rest = arguments[0], arguments[1:]
    if verb == "--version":
        print_output(f"dembrick {__version__}")
        if {"-v", "--verbose"} & set(rest):
            from dembrick._jit import versions

            print_output("\n".join(versions()))
        return 0
    if verb not in VERBS:
        from dembrick.scenario.checks import nearest

        message = f"unknown command {verb!r}; {nearest(verb, VERBS)}"
        _failed_json(message, rest)
        print_error(f"error: {message}")
        return 2
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # escape characters that the terminal cannot encode
    gc.set_threshold(GARBAGE)
    atexit.register(gc.freeze)  # collecting garbage at exit gains nothing
    import argparse

    class Parser(argparse.ArgumentParser):
        def error(self, message):
            """Report an error as argparse does, with a hint, and as JSON if asked for."""
            message += _meant(message, self._option_string_actions)
            if verb == "render" and message.startswith("unrecognized arguments") and "--to" in rest:
                message += "; to name several files, repeat --to before each"
            _failed_json(message, rest)
            super().error(message)

    parser = Parser(prog=f"dembrick {verb}")
    _add_arguments(parser, verb)
    module, options = _module(verb), parser.parse_args(_lists_joined(rest))
    from dembrick.cli.console import Console
    from dembrick.simulation.interrupts import handled, requested

    console = Console(json=options.json, quiet=options.quiet, verbose=options.verbose)
    try:
        with handled(), _compiling(verb, console):
            code = module.run(options, console)
            if signum := requested():  # too late to stop anything, but the caller should know
                console.say("interrupted after the work was done; nothing was lost")
                return 128 + signum
            return code
    except DembrickError as error:
        console.failed(error)
        return error.exit_code
    except KeyboardInterrupt as error:
        if console.json and not console.answered:
            console.result({"status": "interrupted"}, "")
        console.say(str(error) or "interrupted")
        return getattr(error, "exit_code", 130)


def _lists_joined(arguments: list[str]) -> list[str]:
    """The arguments, with ``--direction -1,0,0`` as ``--direction=-1,0,0``: argparse would take a list that begins
    with a minus sign for an option."""
    import re

    joined: list[str] = []
    for argument in arguments:
        if joined and re.fullmatch(r"--[a-z-]+", joined[-1]) and re.match(r"-\.?\d[^,]*,", argument):
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined


def _meant(message: str, known: Iterable[str]) -> str:
    """The options that were probably meant by those that a ``message`` of argparse does not know, to go behind it."""
    from difflib import get_close_matches

    if not message.startswith("unrecognized arguments"):
        return ""
    unknown = [word.partition("=")[0] for word in message.partition(": ")[2].split() if word.startswith("--")]
    names = [option[2:] for option in known if option.startswith("--")]
    meant = [f"--{name}" for word in unknown for name in get_close_matches(word[2:], names, 1)]
    return f"; did you mean {' and '.join(dict.fromkeys(meant))}?" if meant else ""


def _failed_json(message: str, arguments: list[str]) -> None:
    """Print the JSON object of a command line that cannot be parsed, if it asks for JSON."""
    if "--json" in arguments:
        import json

        print_output(json.dumps({"status": "failed", "error": message}, indent=2))


@contextmanager
def _compiling(verb: str, console):
    """For commands that simulate: report when kernels are compiled, and let a second process compile some of them."""
    if verb not in SIMULATING:
        yield
        return
    from dembrick._ahead import second_process
    from dembrick._packaged_kernels import why_compiled
    from dembrick.cli.progress import telling_of_compilation

    def tell(text: str) -> None:
        console.meter.stage(text)
        if reason := why_compiled():
            console.detail(f"compiling kernels here instead of taking those of the package: {reason}")

    with telling_of_compilation(tell), second_process():
        yield
