"""A YAML file as places: each value with its key and line, so that every refusal can name them.

Strict as the simulator is: keys that are missing, unknown or repeated and values of another kind
end with an InputError `FILE:LINE: key: what is wrong, what would be right`.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import yaml

from .problem import InputError

# YAML 1.1 reads 010 as octal, which nobody means: it is no number here, nor in onebit-sim.
NUMBER = re.compile(r"[+-]?(?!0\d)(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
INTEGER = re.compile(r"(?!0\d)\d+")


@dataclass
class Place:
    """A value in the file: `key` as topology.graphs[1].edges[3], places in lists from 1."""

    path: Path
    key: str
    node: yaml.Node

    def refuse(self, what: str, line: int | None = None) -> NoReturn:
        line = self.node.start_mark.line + 1 if line is None else line
        raise InputError(f"{self.path}:{line}: {self.key + ': ' if self.key else ''}{what}")

    @property
    def seen(self) -> str:
        """What a person sees there: a value in quotes, else what kind of value it is."""
        if isinstance(self.node, yaml.ScalarNode):
            return f"'{self.node.value[:40]}'" if self.node.value else "nothing"
        return "a list" if isinstance(self.node, yaml.SequenceNode) else "a mapping"

    @property
    def plain(self) -> str:
        """The text of a scalar without quotation marks, else empty."""
        is_plain = isinstance(self.node, yaml.ScalarNode) and self.node.style is None
        return self.node.value if is_plain else ""

    @property
    def is_mapping(self) -> bool:
        return isinstance(self.node, yaml.MappingNode)

    @property
    def names(self) -> set[str]:
        """The keys of a mapping, as far as they are words; none of another value."""
        if not self.is_mapping:
            return set()
        return {key.value for key, _ in self.node.value if isinstance(key, yaml.ScalarNode)}

    def section(self, required: Sequence[str], optional: Sequence[str] = ()) -> dict[str, "Place"]:
        """The values of a mapping that has all of the required keys and no others."""
        names = ", ".join([*required, *(f"{name} (optional)" for name in optional)])
        if not self.is_mapping:
            self.refuse(f"must be a mapping with the keys {names}, not {self.seen}")
        places: dict[str, Place] = {}
        for key_node, value in self.node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                self.at(key_node).refuse("keys must be words")
            name = key_node.value
            place = Place(self.path, f"{self.key}.{name}" if self.key else name, value)
            line = key_node.start_mark.line + 1
            if name not in required and name not in optional:
                place.refuse(f"unknown key, must be one of {names}", line)
            if name in places:
                place.refuse("repeated, must stand once", line)
            places[name] = place
        for name in required:
            if name not in places:
                missing = Place(self.path, f"{self.key}.{name}" if self.key else name, self.node)
                missing.refuse(f"missing, must be given; this section has the keys {names}")
        return places

    def at(self, node: yaml.Node) -> "Place":
        return Place(self.path, self.key, node)

    def items(self, what: str, least: int, most: int | None = None) -> list["Place"]:
        """The values of a list with so many of them."""
        if not isinstance(self.node, yaml.SequenceNode):
            self.refuse(f"must be a list of {what}, not {self.seen}")
        count = len(self.node.value)
        if count < least or (most is not None and count > most):
            wanted = (
                f"{least}"
                if least == most
                else f"at least {least}"
                if count < least
                else f"at most {most}"
            )
            self.refuse(f"has {count} {what}, must have {wanted}")
        return [
            Place(self.path, f"{self.key}[{number}]", node)
            for number, node in enumerate(self.node.value, 1)
        ]

    def number(self) -> float:
        value = float(self.plain) if NUMBER.fullmatch(self.plain) else math.nan
        if not math.isfinite(value):
            self.refuse(f"must be a finite decimal number, not {self.seen}")
        return value

    def positive(self) -> float:
        value = self.number()
        if not value > 0:
            self.refuse(f"must be above 0, not {self.seen}")
        return value

    def integer(self, least: int, most: int) -> int:
        value = int(self.plain) if INTEGER.fullmatch(self.plain) else -1
        if not least <= value <= most:
            self.refuse(f"must be a whole number from {least} to {most}, not {self.seen}")
        return value

    def choice(self, *words: str) -> str:
        if not isinstance(self.node, yaml.ScalarNode) or self.node.value not in words:
            self.refuse(f"must be {', '.join(words[:-1])} or {words[-1]}, not {self.seen}")
        return self.node.value

    def text(self) -> str:
        if not isinstance(self.node, yaml.ScalarNode) or not self.node.value:
            self.refuse(f"must be a word or a line of text, not {self.seen}")
        return self.node.value

    def row(self, columns: int) -> list[float]:
        return [item.number() for item in self.items("numbers", columns, columns)]


def load(path: Path) -> Place:
    """The one document of a file."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        node = yaml.compose(content, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise InputError(f"{path}:{line}: must be one YAML document, but {error.problem}") from None
    except yaml.reader.ReaderError as error:
        # Such errors carry no mark, but the place of a byte or character.
        line = content[: error.position].count(b"\n") + 1
        raise InputError(f"{path}:{line}: must be YAML, but {error.reason}") from None
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply") from None
    if node is None:
        raise InputError(f"{path}:1: is empty, must describe a system")
    return Place(path, "", node)
