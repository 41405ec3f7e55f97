"""The figures and conditions of the paper's Theorems 1-4, under the names of design.json.

The norms need no matrix with a row a link: with D_i the degrees in graph i, D those of the union
and J = I - 11'/N, ||J W_i||^2 is the largest eigenvalue of J D_i J, ||Q W_i||^2 the largest entry
of D_i D, ||Q L_i T||^2 the largest eigenvalue of L_i D L_i.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from . import gains, network
from .system import System

# Of K2 (A + B K1) = K2 and K2 B = 1, as onebit-sim has it.
GAIN_ROUNDING = 1e-6
# The error of the plant's entries that `horizon` is told for.
PLANT_ERROR = 1e-3


@dataclass
class NetworkFigures:
    """What depends on the graphs and the chain alone."""

    lambda_2: float
    lambda_G: float
    lambda_QW: float
    lambda_QL: float
    pi: np.ndarray
    pi_min: float
    d_max: int
    alpha: float


def network_figures(system: System) -> NetworkFigures:
    laplacians = [system.laplacian(graph) for graph in range(len(system.graphs))]
    pi = network.stationary(system.transition)
    averaged = sum(weight * matrix for weight, matrix in zip(pi, laplacians, strict=True))
    lambda_2 = float(np.linalg.eigvalsh(averaged)[1])
    degrees = [np.diag(matrix) for matrix in laplacians]
    union = np.zeros(system.agents)
    for sender, _ in system.links:
        union[sender - 1] += 1
    centring = np.eye(system.agents) - 1 / system.agents
    lambda_G = max(
        float(np.linalg.eigvalsh(centring * degree @ centring)[-1]) for degree in degrees
    )
    lambda_QW = max(float(np.max(degree * union)) for degree in degrees)
    lambda_QL = max(float(np.linalg.eigvalsh(matrix * union @ matrix)[-1]) for matrix in laplacians)
    return NetworkFigures(
        lambda_2=lambda_2,
        lambda_G=lambda_G,
        lambda_QW=lambda_QW,
        lambda_QL=lambda_QL,
        pi=pi,
        pi_min=float(pi.min()),
        d_max=int(max(degree.max() for degree in degrees)),
        alpha=2 * math.sqrt(lambda_QW) + lambda_QL * lambda_2 / lambda_G,
    )


def least_density(threshold: float, bound: float, sigma: float) -> float:
    """f_M: the noise's density where the bits carry least."""
    return float(norm.pdf(abs(threshold) + bound, scale=sigma))


def beta_consensus(figures: NetworkFigures, gamma: float, f_M: float) -> float:
    """Theorems 1 and 3, first part: beta above this gives consensus."""
    ratio = figures.lambda_G**2 / figures.lambda_2**3
    return gamma * (ratio + figures.alpha) / (2 * f_M * figures.pi_min)


def beta_rate(figures: NetworkFigures, gamma: float, f_M: float) -> float:
    """Second part: beta above this gives the rate 1/t, where gamma > 1/lambda_2; else infinite."""
    excess = gamma * figures.lambda_2 - 1
    if excess <= 0:
        return math.inf
    ratio = (gamma * figures.lambda_G / figures.lambda_2) ** 2
    return (ratio / excess + gamma * figures.alpha + 1) / (2 * f_M * figures.pi_min)


@dataclass
class Horizon:
    """Until when the group holds together on a plant whose entries are off by PLANT_ERROR each.

    K2 is the left eigenvector of A + B K1 for the eigenvalue 1 and v1 the right one, K2 v1 = 1, so
    a small error moves the eigenvalue by K2 (dA + dB K1) v1: `A[i][j] = K2_i v1_j` and
    `B[i] = K2_i (K1 v1)` are its derivatives by the entries.
    """

    t: float  # all entries off, every sign the worst
    eigenvalue_error: float
    A: np.ndarray
    B: np.ndarray
    entry: str  # the one that moves the eigenvalue most
    entry_share: float  # of eigenvalue_error
    exact_t: float  # the same with entries that are 0 or 1 exactly, an integrator's, without error


def horizon(system: System, lambda_2: float) -> Horizon:
    v1 = gains.agreed_direction(system.A, system.B, system.K1, system.K2)
    by_A = np.outer(system.K2, v1)
    by_B = system.K2 * (system.K1 @ v1)
    shifts_A = PLANT_ERROR * np.abs(by_A * system.A)
    shifts_B = PLANT_ERROR * np.abs(by_B * system.B)
    shift = float(shifts_A.sum() + shifts_B.sum())
    # What only rounding keeps from zero moves nothing.
    inexact = float(
        shifts_A[(system.A != 0) & (system.A != 1)].sum() + shifts_B[system.B != 1].sum()
    )
    row, column = np.unravel_index(np.argmax(shifts_A), shifts_A.shape)
    largest, entry = float(shifts_A[row, column]), f"A[{row + 1}][{column + 1}]"
    if shifts_B.max() > largest:
        largest, entry = float(shifts_B.max()), f"B[{int(np.argmax(shifts_B)) + 1}]"

    def until(error: float) -> float:
        return system.gamma * lambda_2 / error if error > gains.ROUNDING else math.inf

    return Horizon(until(shift), shift, by_A, by_B, entry, largest / shift, until(inexact))


@dataclass
class Condition:
    """One condition: `value` must stand to `limit` as `holds` says; `margin` is how far it is."""

    name: str
    holds: bool
    value: float | None
    limit: float | None
    margin: str
    mend: str  # empty where it holds


def _above(name: str, value: float, limit: float, mend: str) -> Condition:
    holds = bool(value > limit)
    if limit > 0 and math.isfinite(limit):
        margin = f"{value:.6g} is {value / limit:.4g} times {limit:.6g}"
    else:
        margin = f"{value:.6g} against {limit:.6g}"
    return Condition(name, holds, value, limit, margin, "" if holds else mend)


def _at_most(name: str, value: float, limit: float, mend: str) -> Condition:
    holds = bool(value <= limit)
    margin = f"{value:.6g} of {limit:.6g}"
    return Condition(name, holds, value, limit, margin, "" if holds else mend)


@dataclass
class Figures:
    """All that design.json says of the theorems."""

    network: NetworkFigures
    P: np.ndarray
    f_M: float
    beta_consensus: float
    beta_rate: float
    gamma_min: float
    t0_min: float
    eigenvalues: np.ndarray  # of A + B K1, the one nearest to 1 first
    horizon: Horizon
    conditions: list[Condition]


def compute(system: System, controllability: gains.Controllability) -> Figures:
    figures = network_figures(system)
    f_M = least_density(system.threshold, system.bound, system.sigma)
    consensus = beta_consensus(figures, system.gamma, f_M)
    rate = beta_rate(figures, system.gamma, f_M)
    gamma_min = 1 / figures.lambda_2
    t0_min = system.gamma * figures.d_max - 1
    closed = system.A + np.outer(system.B, system.K1)
    eigenvalues = np.linalg.eigvals(closed)
    eigenvalues = eigenvalues[np.argsort(np.abs(eigenvalues - 1))]
    row_error = float(np.abs(system.K2 @ closed - system.K2).max() / np.abs(system.K2).max())
    unit_error = float(abs(system.K2 @ system.B - 1))
    compressed = np.abs(system.initial_states @ system.K2)
    others = float(np.abs(eigenvalues[1:]).max(initial=0))
    n = len(system.B)
    digits = "compute both rows from A and B as the file has them, to all digits, or give roots"
    conditions = [
        Condition(
            "(A, B) controllable",
            controllability.rank == n,
            controllability.rank,
            n,
            f"rank {controllability.rank} of {n}, condition {controllability.condition:.3g} "
            f"costs {gains.digits_lost(controllability.condition):.1f} of 16 digits",
            "",
        ),
        _at_most(
            "gains lose at most half of their digits",
            controllability.condition,
            gains.CONDITION_LIMIT,
            "measure the states in units of like size, or take a longer sample period",
        ),
        _at_most("K2 (A + B K1) = K2, error relative to K2", row_error, GAIN_ROUNDING, digits),
        _at_most("K2 B = 1, error", unit_error, GAIN_ROUNDING, digits),
        Condition(
            "roots inside the unit circle",
            others < 1,
            others,
            1.0,
            f"largest magnitude {others:.6g}",
            "" if others < 1 else "choose roots below 1",
        ),
        _above("lambda_2 > 0 (graphs jointly connected)", figures.lambda_2, 0, "add edges"),
        Condition(
            "chain irreducible and aperiodic",
            True,
            None,
            None,
            "one graph"
            if len(system.graphs) == 1
            else f"{len(system.graphs)} graphs, pi_min = {figures.pi_min:.4g}",
            "",
        ),
        _above(
            "beta for consensus",
            system.beta,
            consensus,
            f"raise beta above {consensus:.6g}",
        ),
        _above(
            "gamma > 1/lambda_2 for the rate 1/t",
            system.gamma,
            gamma_min,
            f"raise gamma above {gamma_min:.6g} (and t0 and beta with it)",
        ),
        _above(
            "beta for the rate 1/t",
            system.beta,
            rate,
            f"raise beta above {rate:.6g}"
            if math.isfinite(rate)
            else f"raise gamma above {gamma_min:.6g} first",
        ),
        _above(
            "t0 > gamma d_max - 1",
            system.t0,
            t0_min,
            f"raise t0 to {math.floor(t0_min) + 1}",
        ),
        _at_most(
            "|K2 x| of every initial state within the bound",
            compressed.max(),
            system.bound,
            "raise the bound",
        ),
        _at_most(
            "|zhat| initially within the bound",
            abs(system.initial_estimate),
            system.bound,
            "raise the bound",
        ),
    ]
    return Figures(
        network=figures,
        P=gains.brunovsky(system.A, system.B),
        f_M=f_M,
        beta_consensus=consensus,
        beta_rate=rate,
        gamma_min=gamma_min,
        t0_min=t0_min,
        eigenvalues=eigenvalues,
        horizon=horizon(system, figures.lambda_2),
        conditions=conditions,
    )
