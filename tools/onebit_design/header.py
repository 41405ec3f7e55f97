"""onebit_config.h: a system's constants as the library's configurations, for f32 and q31.

The q31 integers are those that sim/group.c and sim/plant.c compute from the scenario, so that
firmware and simulator command the same bits.
"""

import math
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


def coefficient(value: float) -> tuple[int, int]:
    """sim/group.c's coefficient: all 32 bits of the integer, as far as its exponent allows."""
    _, exponent = math.frexp(value)
    bits = min(32 - exponent, 62)
    scaled = math.floor(math.ldexp(value, bits) + 0.5)
    if scaled > 2**32 - 1:  # rounded up to a power of two
        scaled //= 2
        bits -= 1
    return scaled, bits


def single(value: float) -> str:
    """The nearest float as a C literal that reads back as the same bits."""
    text = str(np.float32(value)).lower()
    return f"{text}f" if "." in text or "e" in text else f"{text}.0f"


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
    estimate = system.initial_estimate / system.sigma
    # As in sim/group.c: (|c| + M)/sigma = 4 is allowed, and rounding must not carry it beyond.
    threshold = np.float32(system.threshold / system.sigma)
    bound = min(np.float32(system.bound / system.sigma), np.float32(4) - abs(threshold))
    return environment.get_template("onebit_config.h.jinja").render(
        system=system,
        name=comment(system.name),
        formats=formats,
        room=_room,
        base=base_of(system.bus) if system.mode == "broadcast" else 0,
        neighbours=neighbours,
        plant=_plant(system, formats) if system.integer_plant else None,
        q31={
            "stabilizing": [fixed(value, formats.stabilizing) for value in system.K1],
            "compression": [fixed(value, formats.compression) for value in scaled],
            "threshold": fixed(system.threshold / system.sigma, NOISE_FRACTION_BITS),
            "bound": fixed(system.bound / system.sigma, NOISE_FRACTION_BITS),
            "estimate": fixed(estimate, NOISE_FRACTION_BITS),
            "estimator_gain": coefficient(system.beta / system.sigma),
            "control_gain": coefficient(system.gamma * system.sigma),
        },
        f32={
            "stabilizing": [single(value) for value in system.K1],
            "compression": [single(value) for value in scaled],
            "threshold": single(threshold),
            "bound": single(bound),
            "estimate": single(estimate),
            "estimator_gain": single(system.beta / system.sigma),
            "control_gain": single(system.gamma * system.sigma),
        },
    )
