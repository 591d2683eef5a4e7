"""The key numbers of a result as the command line prints them: by name, and as words without their columns."""

from dembrick.views.key_numbers import key_numbers
from dembrick.views.number_lines import KeyNumber, aligned


def key_lines(result) -> dict[str, str]:
    """Lines of the key numbers of a result by their names, one space between words."""
    return lines_of(key_numbers(result.as_dict(), result.curve.unit))


def lines_of(numbers) -> dict[str, str]:
    """The same of key numbers, or of tuples that make some."""
    found = [KeyNumber(*number) for number in numbers]
    return {number.name: words(aligned([number])[0]) for number in found}


def words(text: str) -> str:
    """A text with one space between words."""
    return " ".join(text.split())
