"""onebit_config.h: a system's constants as the library's configurations, in every arithmetic.

The q31 integers are those that sim/group.c and sim/plant.c compute from the scenario, so that
firmware and simulator command the same bits.
"""

import math
from itertools import accumulate
from pathlib import Path

import jinja2
import numpy as np

from .bus_cost import base_of
from .formats import Formats, fit_plant_rows
from .system import System

NOISE_FRACTION_BITS = 27  # Q4.27, the library's noise units in q31
WORD_LAST = 2**31 - 1


def fixed(value: float, bits: int) -> int:
    """sim/group.c's real_from_double: nearest, half away from zero, saturated."""
    scaled = value * 2.0**bits
    if not scaled < WORD_LAST:
        return WORD_LAST
    if scaled <= -(2.0**31):
        return -(2**31)
    return int(scaled + math.copysign(0.5, scaled))


def rounded(value: float, bits: int) -> int:
    """sim/plant.c's fixed: the same, where `fixed` takes 2^-54 below a half for a half."""
    magnitude = abs(value) * 2.0**bits
    whole = math.floor(magnitude)
    whole += magnitude - whole >= 0.5
    return min(whole, WORD_LAST) if value > 0 else -min(whole, WORD_LAST + 1)


def _plant(system: System, formats: Formats) -> dict:
    """The integer plant: fraction bits of A and B, their integers, the agents' first states."""
    A_bits, B_bits = fit_plant_rows(system.A), fit_plant_rows(system.B[:, np.newaxis])
    return {
        "A_bits": A_bits,
        "B_bits": B_bits,
        "A": [[rounded(float(value), A_bits) for value in row] for row in system.A],
        "B": [rounded(float(value), B_bits) for value in system.B],
        "initial": [
            [rounded(float(value), formats.state) for value in row] for row in system.initial_states
        ],
    }


def coefficient(value: float) -> tuple[float, str, int]:
    """The number; sim/group.c's coefficient: all 32 bits of its integer, and fraction bits."""
    fraction, exponent = math.frexp(value)
    scaled = math.floor(math.ldexp(fraction, 32) + 0.5)
    if scaled > 2**32 - 1:  # rounded up to a power of two
        scaled //= 2
        exponent += 1
    return value, f"{scaled}u", 32 - exponent


def comment(text: str) -> str:
    """What a C comment may hold of a text that people wrote."""
    printable = "".join(letter if letter.isprintable() else "?" for letter in text)
    return printable.replace("*/", "* /").replace("/*", "/ *")


def _room(value: float, bits: int) -> str:
    """How much room a format with so many fraction bits leaves over a range."""
    if value == 0:
        return "the range is 0"
    spare = math.log2(2.0 ** (31 - bits) / value)
    return f"{spare:.1f} bits to spare"


def render(system: System, formats: Formats) -> str:
    neighbours = [[] for _ in range(system.agents)]
    for sender, receiver in system.links:
        neighbours[receiver - 1].append(sender)
    scaled = system.K2 / system.sigma
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # C, not HTML
    )
    # As in sim/group.c: (|c| + M)/sigma = 4 is allowed, and rounding each to a float must not carry
    # their sum beyond.
    threshold = system.threshold / system.sigma
    bound = system.bound / system.sigma
    room = np.float32(4) - abs(np.float32(threshold))
    bound_number = bound if np.float32(bound) <= room else float(room)
    # Graphs are undirected: an agent sends to those that it hears.
    degrees = [len(numbers) for numbers in neighbours]
    first_links = list(accumulate(degrees[:-1], initial=1))
    if system.mode == "broadcast":
        first_links = [0] * system.agents

    def noise(value: float) -> tuple[float, int]:
        return value, fixed(value, NOISE_FRACTION_BITS)

    return environment.get_template("onebit_config.h.jinja").render(
        system=system,
        name=comment(system.name),
        formats=formats,
        room=_room,
        base=base_of(system.bus) if system.mode == "broadcast" else 0,
        period_nanoseconds=round(system.period * 1e9),
        neighbours=neighbours,
        first_links=first_links,
        plant=_plant(system, formats) if system.integer_plant else None,
        # Numbers for the floating arithmetics, each with the integer that q31 takes.
        real={
            "stabilizing": [(value, fixed(value, formats.stabilizing)) for value in system.K1],
            "compression": [(value, fixed(value, formats.compression)) for value in scaled],
            "threshold": noise(threshold),
            "bound": (bound_number, fixed(bound, NOISE_FRACTION_BITS)),
            "estimate": noise(system.initial_estimate / system.sigma),
            "estimator_gain": coefficient(system.beta / system.sigma),
            "control_gain": coefficient(system.gamma * system.sigma),
        },
    )
