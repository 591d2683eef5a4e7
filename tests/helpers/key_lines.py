"""The key numbers of a result as the command line prints them: by name, or as words without column spacing."""

from dembrick.views.key_numbers import key_numbers
from dembrick.views.number_lines import KeyNumber, aligned


def key_lines(result) -> dict[str, str]:
    """Lines of the key numbers of a result by name, with single spaces between words."""
    return lines_of(key_numbers(result.as_dict(), result.curve.unit))


def lines_of(numbers) -> dict[str, str]:
    """The same lines from key numbers, or from tuples that define some."""
    found = [KeyNumber(*number) for number in numbers]
    return {number.name: words(aligned([number])[0]) for number in found}


def words(text: str) -> str:
    """A text with single spaces between words."""
    return " ".join(text.split())
