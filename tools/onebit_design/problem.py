"""What ends onebit-design with exit status 2: a line that names file, line, key and reason."""


class InputError(Exception):
    """Bad use or input; the text is the one line for the person."""

    def __init__(self, text: str):
        # Names and values come from files: whatever they hold, the problem stays one line.
        super().__init__("".join(letter if letter.isprintable() else "?" for letter in text))
