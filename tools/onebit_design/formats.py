"""Fixed-point formats from the closed loop's worst-case ranges: the choices of sim/formats.c, whose
comment has the derivation. A format with f fraction bits: value = integer / 2^f, 32 bits.
"""

import math
from dataclasses import dataclass

import numpy as np

from . import gains
from .system import System

FRACTION_BITS_MAX = 31
ROW_FRACTION_BITS_MAX = 46  # the library's range of a row's fraction bits
NEGLIGIBLE = 1e-9  # the sums end where a power of S has shrunk so far
POWERS_MAX = 100_000
WORD = 2.0**31


class FormatError(Exception):
    """No format holds the range, or the given one does not; `name` is the key that is at fault."""

    def __init__(self, name: str, text: str):
        super().__init__(text)
        self.name = name


@dataclass
class Formats:
    state: int  # fraction bits of the states
    control: int
    stabilizing: int  # of the row K1
    compression: int  # of the row K2 / sigma
    state_range: float  # worst case of every |x_k|
    control_range: float  # of |u|
    chosen: bool  # state and control, by this module; else the file gave them


def _ranges(system: System) -> tuple[float, float]:
    """Worst cases of |x_k| and |u|; infinite if the loop does not decay."""
    A, B, K1, K2 = system.A, system.B, system.K1, system.K2
    try:
        v1 = gains.agreed_direction(A, B, K1, K2)
    except np.linalg.LinAlgError:
        return math.inf, math.inf
    unagreed = np.eye(len(B)) - np.outer(v1, K2)
    decaying = A + np.outer(B, K1) - np.outer(v1, K2)
    d_max = max(int(np.diag(system.laplacian(graph)).max()) for graph in range(len(system.graphs)))
    # K2 x' = (1 - a) K2 x + a mean of zhat: while a <= 1 nothing leaves M, but a t0 below the
    # theorem's may begin above.
    compressed, consensus = system.bound, 0.0
    t = system.t0 + 1
    while True:
        a = system.gamma * d_max / (t + 1)
        consensus = max(consensus, a * (compressed + system.bound))
        compressed = max(compressed, (a - 1) * compressed + a * system.bound)
        if not (a > 1 and math.isfinite(compressed)):
            break
        t += 1
    # Columns: the response to the consensus term, then to each initial state.
    responses = unagreed @ np.column_stack([B, system.initial_states.T])
    powers = unagreed.copy()  # shows when everything has decayed
    driven = np.zeros(len(B))
    free = np.zeros(len(B))
    largest = 1.0
    for _ in range(POWERS_MAX):
        driven += np.abs(responses[:, 0]) * consensus
        free = np.maximum(free, np.abs(responses[:, 1:]).max(axis=1))
        responses = decaying @ responses
        powers = decaying @ powers
        size = float(np.abs(powers).sum())
        if not math.isfinite(size):
            break
        largest = max(largest, size)
        if size <= NEGLIGIBLE * largest:
            states = np.abs(v1) * compressed + free + driven
            return float(states.max()), float(consensus + np.abs(K1) @ states)
    return math.inf, math.inf


def _fit_range(value: float) -> int:
    """Most fraction bits that leave one bit to spare over the range, -1 if none does."""
    bits = FRACTION_BITS_MAX
    while bits >= 0 and not 2 * value * 2.0**bits <= WORD:
        bits -= 1
    return bits


def _fit_row(row: np.ndarray, scale: float) -> int:
    """Most fraction bits at which the row's integers, in magnitude, add to at most 2^31 - 1."""
    for bits in range(ROW_FRACTION_BITS_MAX, -1, -1):
        # C's round: half away from zero.
        if np.floor(np.abs(row * scale) * 2.0**bits + 0.5).sum() <= WORD - 1:
            return bits
    return -1


def fit_plant_rows(rows: np.ndarray) -> int:
    """sim/plant.c's row_fraction_bits: most, up to 30, at which the magnitudes of every row's
    integers add to less than 2^31, whichever way they are rounded."""
    largest = max(sum(abs(float(value)) for value in row) for row in rows)
    bits = 30
    while bits > 0 and largest * 2.0**bits + rows.shape[1] > WORD - 1:
        bits -= 1
    return bits


def choose(system: System) -> Formats:
    state_range, control_range = _ranges(system)
    if not math.isfinite(state_range):
        raise FormatError(
            "gains",
            "q31 needs a bounded range, but A + B K1 has, beside 1, an eigenvalue that is not "
            "inside the unit circle, or hardly: choose smaller roots",
        )
    state, control = _fit_range(state_range), _fit_range(control_range)
    for what, bits, value in (("states", state, state_range), ("controls", control, control_range)):
        if bits < 0:
            raise FormatError(
                "plant",
                f"{what} may reach {value:.3g}, q31 holds at most {WORD / 2:.3g} with one bit to "
                "spare: measure them in larger units",
            )
    given = system.fixed
    for key, value, best in (
        ("state_fraction_bits", state_range, state),
        ("control_fraction_bits", control_range, control),
    ):
        if given and not value * 2.0 ** given[key] <= WORD - 1:
            raise FormatError(
                key,
                f"{given[key]} fraction bits hold at most {WORD / 2.0 ** given[key]:.4g}, the "
                f"worst case is {value:.4g}: must be at most {best} for one bit to spare, or let "
                "the tool choose by leaving `fixed` out",
            )
    stabilizing, compression = _fit_row(system.K1, 1), _fit_row(system.K2, 1 / system.sigma)
    for what, bits in (("K1", stabilizing), ("K2 / sigma", compression)):
        if bits < 0:
            raise FormatError(
                "gains",
                f"{what} is too large for q31, magnitudes must add to at most 2^31 - 1: measure "
                "states in smaller units or the input in larger ones",
            )
    return Formats(
        given.get("state_fraction_bits", state),
        given.get("control_fraction_bits", control),
        stabilizing,
        compression,
        state_range,
        control_range,
        not given,
    )
