"""From a plant and roots to the gain rows K1 and K2 (paper, Algorithm 1 and Remark on P).

With q the last row of the inverse of the controllability matrix [B, AB, .., A^(n-1) B], the rows of
P are q, qA, .., q A^(n-1): P A P^-1 is a companion matrix (Brunovsky's form) and P B = e_n. Roots
r_1..r_(n-1) give s^(n-1) + b_(n-1) s^(n-2) + .. + b_1 and K2 = [b_1 .. b_(n-1) 1] P.
"""

from dataclasses import dataclass

import control
import numpy as np

# Relative error of a double, and what is left when half of its digits are lost.
ROUNDING = np.finfo(float).eps
CONDITION_LIMIT = 1 / np.sqrt(ROUNDING)
# Relative to the largest, a singular value that rounding of the powers of A may leave of a zero.
RANK_ROUNDING = 1e-12


def discretize(Ac: np.ndarray, Bc: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Zero-order hold: x(t+1) = A x(t) + B u(t) a period later."""
    n = len(Bc)
    continuous = control.ss(Ac, Bc.reshape(n, 1), np.eye(n), np.zeros((n, 1)))
    discrete = control.sample_system(continuous, period, method="zoh")
    return np.asarray(discrete.A), np.asarray(discrete.B).reshape(n)


@dataclass
class Controllability:
    """How far inputs reach: of [B, AB, .., A^(n-1) B] the rank, the 2-norm condition number, and
    that number after each state has been measured in a unit of its own (rows of norm one)."""

    rank: int
    condition: float
    scaled_condition: float
    units: np.ndarray  # the norm of each row: what to divide each state by


def controllability(A: np.ndarray, B: np.ndarray) -> Controllability:
    matrix = control.ctrb(A, B.reshape(-1, 1))
    units = np.linalg.norm(matrix, axis=1)
    known_units = np.where(units > 0, units, 1)
    scaled = matrix / known_units[:, None]
    # The rank depends neither on units nor on the size of A, so they must not spoil it. A column
    # is measured against |A|^k |B|, not against itself: where a power vanishes only rounding is
    # left of it.
    size = np.linalg.norm(A * known_units / known_units[:, None], 2) or 1
    with np.errstate(over="ignore"):  # a plant too fast for a double: its powers count as zero
        krylov = scaled / size ** np.arange(len(B))
    values = np.linalg.svd(krylov, compute_uv=False)
    rank = np.sum(values > RANK_ROUNDING * values[0])
    return Controllability(
        int(rank), float(np.linalg.cond(matrix)), float(np.linalg.cond(scaled)), units
    )


def digits_lost(condition: float) -> float:
    """Decimal digits, of the 16 that a double has, that a solution with this condition loses."""
    return float(np.log10(condition))


def brunovsky(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """P. For a controllable pair."""
    n = len(B)
    last = np.zeros(n)
    last[-1] = 1
    row = np.linalg.solve(control.ctrb(A, B.reshape(-1, 1)).T, last)
    rows = [row]
    for _ in range(n - 1):
        rows.append(rows[-1] @ A)
    return np.array(rows)


def rows(A: np.ndarray, B: np.ndarray, roots: list[complex]) -> tuple[np.ndarray, np.ndarray]:
    """K1 and K2 for n - 1 roots, complex ones with their conjugates."""
    coefficients = np.real(np.poly(roots))[::-1] if roots else np.ones(1)  # b_1 .. b_(n-1), 1
    compression = coefficients @ brunovsky(A, B)
    # K2 B = 1 to the last digit. K1 = K2 - K2 A is the paper's K1~ P, written so that
    # K2 (A + B K1) = K2 holds to the last digit too, however P was rounded: the method rests on it.
    compression = compression / (compression @ B)
    return compression - compression @ A, compression


def agreed_direction(A: np.ndarray, B: np.ndarray, K1: np.ndarray, K2: np.ndarray) -> np.ndarray:
    """v1, the eigenvector of A + B K1 for the eigenvalue 1 with K2 v1 = 1: what agents agree on.

    From (I - (A + B K1) + B K2) v1 = B, which holds for no other vector.
    """
    return np.linalg.solve(np.eye(len(B)) - A - np.outer(B, K1 - K2), B)
