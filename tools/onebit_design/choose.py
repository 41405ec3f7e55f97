"""Numbers that the input leaves to the tool (`auto`): each is chosen from the condition that it
serves, with a margin that is stated, never a fixed default."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.stats import norm

from . import conditions
from .reader import ESTIMATOR_GAIN_MAX, REACH_MAX, Request
from .system import System

BOUND_MARGIN = 1.1  # over the largest initial |K2 x| and |zhat|
GAMMA_MARGIN = 1.25  # at least, over 1/lambda_2
BETA_MARGIN = 1.1  # over the theorem's bound
LOGARITHM_MAX = 700.0  # of an error that is no number


@dataclass
class Choice:
    name: str
    value: float
    reason: str


def rounded_up(value: float, digits: int = 3) -> float:
    """To so many significant digits, never below the value."""
    place = digits - 1 - math.floor(math.log10(value))
    rounded = round(value, place)
    return rounded if rounded >= value else round(rounded + 10.0**-place, place)


def fisher_information(threshold: float, z: float | np.ndarray, sigma: float):
    """Of one bit about z: f(c - z)^2 / (F (1 - F))."""
    u = (threshold - z) / sigma
    return (norm.pdf(u) / sigma) ** 2 / (norm.cdf(u) * norm.sf(u))


def _bound(system: System) -> tuple[float, str]:
    largest = max(
        float(np.abs(system.initial_states @ system.K2).max()), abs(system.initial_estimate)
    )
    if largest == 0:
        return system.sigma, "all initial K2 x and estimates are 0; the noise's sigma serves"
    return (
        rounded_up(BOUND_MARGIN * largest),
        f"{BOUND_MARGIN - 1:.0%} over the largest initial |K2 x| or |zhat|, {largest:.6g}; a "
        "larger bound only makes the bits at its ends carry less",
    )


def _threshold(system: System) -> tuple[float, str]:
    # A bit's information falls with |c - z|, on both sides alike, so the worst z in [-M, M] is the
    # end that is farther from c, and c in the middle makes that nearest.
    worst, best = (fisher_information(0, z, system.sigma) for z in (system.bound, 0))
    return 0.0, (
        f"the middle of [-M, M], where the worst bit carries most: "
        f"{worst * system.sigma**2:.4g}/sigma^2, {worst / best:.0%} of the best bit"
    )


def _gamma(figures: conditions.NetworkFigures) -> tuple[float, str]:
    # With g = gamma lambda_2 the bound on beta is a g^2/(g - 1) + b g + 1 over 2 f_M pi_min,
    # a = lambda_G^2/lambda_2^4, b = alpha/lambda_2: least at g = 1 + sqrt(a/(a + b)), below 2.
    a = figures.lambda_G**2 / figures.lambda_2**4
    b = figures.alpha / figures.lambda_2
    g = max(1 + math.sqrt(a / (a + b)), GAMMA_MARGIN)
    return rounded_up(g / figures.lambda_2), (
        f"{g:.3g} times 1/lambda_2 = {1 / figures.lambda_2:.4g}: there the rate 1/t asks the "
        "least of beta"
    )


def _beta(system: System, figures: conditions.NetworkFigures) -> tuple[float, str]:
    f_M = conditions.least_density(system.threshold, system.bound, system.sigma)
    least, what = conditions.beta_rate(figures, system.gamma, f_M), "the rate 1/t"
    if math.isinf(least):
        least, what = conditions.beta_consensus(figures, system.gamma, f_M), "consensus alone"
    return (
        rounded_up(BETA_MARGIN * least),
        f"{BETA_MARGIN - 1:.0%} over what {what} needs, {least:.6g}; more would only let in more "
        "noise",
    )


def _start(gamma: float, d_max: int) -> int:
    return max(1, math.floor(gamma * d_max - 1) + 1)


def _fastest(
    system: System,
    figures: conditions.NetworkFigures,
    automatic: set[str],
    predicted_error: Callable[[System], float],
) -> None:
    """Sets beta and gamma, as far as they are automatic, to the least predicted error after the
    last step.

    The search keeps gamma near the theorem's, else it finds a fraud: with gamma, and t0 with it,
    large enough the estimates stay where they began, and all agree on that within a few steps.
    """
    names = [name for name in ("gamma", "beta") if name in automatic]
    # 1/f gives a single estimate the least variance; the library's range ends the other side.
    best_beta = 1 / norm.pdf(0, scale=system.sigma)
    limits = {
        "gamma": (GAMMA_MARGIN / figures.lambda_2, 3 / figures.lambda_2),
        "beta": (best_beta, ESTIMATOR_GAIN_MAX * system.sigma),
    }
    theorem = {"gamma": system.gamma, "beta": system.beta}
    begin = {"gamma": system.gamma, "beta": 4 * best_beta}

    def apply(logarithms) -> None:
        for name, logarithm in zip(names, logarithms, strict=True):
            setattr(system, name, math.exp(logarithm))
        if "t0" in automatic:
            system.t0 = _start(system.gamma, figures.d_max)

    def cost(logarithms) -> float:
        apply(logarithms)
        error = predicted_error(system)
        return math.log(error) if 0 < error < math.inf else LOGARITHM_MAX

    found = minimize(
        cost,
        [math.log(begin[name]) for name in names],
        method="Nelder-Mead",
        bounds=[tuple(math.log(end) for end in limits[name]) for name in names],
        options={"xatol": 0.02, "fatol": 1e-3, "maxfev": 60},
    )
    ends = [[math.log(rounded_up(math.exp(value))) for value in found.x]]
    if all(limits[name][0] <= theorem[name] <= limits[name][1] for name in names):
        ends.append([math.log(theorem[name]) for name in names])
    apply(min(ends, key=cost))


def choose(
    request: Request, objective: str, predicted_error: Callable[[System], float]
) -> list[Choice]:
    """Fills in what is automatic; says what was chosen and why, in the order of the choices."""
    system, automatic = request.system, request.automatic
    figures = conditions.network_figures(system)
    choices = []

    def take(name: str, value, reason: str) -> None:
        if name in automatic:
            setattr(system, name, value)
            choices.append(Choice(name, value, reason))

    if "bound" in automatic:
        take("bound", *_bound(system))
    if not (abs(system.threshold or 0) + system.bound) / system.sigma <= REACH_MAX:
        # check_numbers refuses it; what follows would divide by densities that are zero.
        take("threshold", 0.0, "")
        for name in automatic:
            setattr(system, name, getattr(system, name) or 1)
        return choices
    if "threshold" in automatic:
        take("threshold", *_threshold(system))
    if "gamma" in automatic:
        take("gamma", *_gamma(figures))
    if "beta" in automatic:
        take("beta", *_beta(system, figures))
    if "t0" in automatic:
        take(
            "t0",
            _start(system.gamma, figures.d_max),
            f"the first above gamma d_max - 1 = {system.gamma * figures.d_max - 1:.6g}; a "
            "later start moves more gently and stays nearer to the initial average",
        )
    if objective == "fast" and automatic & {"beta", "gamma"}:
        _fastest(system, figures, automatic, predicted_error)
        for choice in choices:
            if choice.name in ("beta", "gamma"):
                choice.value = getattr(system, choice.name)
                choice.reason = "least predicted error after the last step; not the theorem's"
            elif choice.name == "t0":
                choice.value = system.t0
                choice.reason = (
                    f"the first above gamma d_max - 1 = {system.gamma * figures.d_max - 1:.6g}"
                )
    return choices
