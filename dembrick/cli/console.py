"""Output of a command: results on standard output, remarks and progress on standard error."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

from dembrick.cli.progress import Meter
from dembrick.cli.streams import print_error, print_output
from dembrick.errors import DembrickError, WriteError


def printable(text: str) -> str:
    """Text for a terminal: line ends and tabs stay, any other control character is written out, as ``\\x1b``.

    Names and remarks may come from an untrusted file, whose escape sequences must not reach the terminal.
    """
    if text.isascii() and text.isprintable():
        return text

    def shown(sign: str) -> str:
        return sign if sign.isprintable() or sign in "\n\t" else sign.encode("unicode_escape").decode("ascii")

    return "".join(map(shown, text))


class Console:
    """Output of one command. ``json``: one JSON object on standard output instead of text."""

    def __init__(self, json: bool, quiet: bool, verbose: bool):
        self.json, self.quiet, self.verbose = json, quiet, verbose
        self.meter = Meter(printable, quiet)
        self.progress = self.meter.count
        self.answered = False  # whether the JSON object has been printed
        self._colour = sys.stderr.isatty() and not os.environ.get("NO_COLOR")

    def result(self, data: dict, text: str) -> None:
        """Print the answer: ``data`` as JSON, or ``text``."""
        if self.json:
            import json

            self.answered = True
            print_output(json.dumps(data, indent=2, allow_nan=False))
        elif text:
            print_output(printable(text))

    def part(self, text: str) -> None:
        """Print a part of the answer that is known before the rest, if it is text; JSON is printed as a whole."""
        if not self.json:
            self.meter.clear()
            print_output(printable(text))

    def failed(self, error: DembrickError) -> None:
        """Report a failure: print a sentence, and the JSON object if it was asked for and has not been printed."""
        if self.json and not self.answered:
            with suppress(WriteError, BrokenPipeError):  # the sentence still says why
                self.result(error.answer or {"status": error.status, "error": str(error)}, "")
        self.error(str(error))

    def say(self, text: str) -> None:
        """Print a line on standard error, whatever the options are."""
        self.meter.clear()
        print_error(printable(text))

    def remark(self, text: str) -> None:
        """Print a remark, unless ``--quiet`` is given."""
        if not self.quiet:
            self.say(text)

    def detail(self, text: str) -> None:
        """Print a remark if ``-v`` is given."""
        if self.verbose:
            self.remark(text)

    def error(self, text: str) -> None:
        """Print why there is no answer, even with ``--quiet``."""
        self.meter.clear()
        label = "\033[31merror:\033[0m" if self._colour else "error:"
        print_error(f"{label} {printable(text)}")
