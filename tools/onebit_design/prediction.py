"""Mean square disagreement against t from a linear model of the whole group, without simulation.

Estimates and states are one stochastic linear system whose gains fall like 1/t:

  zhat_ij(t) = zhat_ij(t-1) + kappa ( m(z_j(t)) - zhat_ij(t-1) ) + noise of variance q
  x_i(t+1)   = (A + B K1) x_i(t) + B gamma/(t+1) sum_j p_ij ( zhat_ij(t) - K2 x_i(t) )

with p_ij the share of steps in which the link is switched on. Mean and covariance of all estimates
and states obey recursions, which `predict` follows from the known start (x(t0+1), zhat(t0)) on.

kappa, m and q come from the estimator's own law (`EstimatorLaw`). For a constant z and a step
a = beta/t held fixed the projected estimate is a Markov chain on [-M, M]. Its stationary mean is
m(z), and kappa and q are chosen so that the linear estimate has its variance V and its noise at low
frequencies, the sum S of all its autocovariances, which is what moves the slow states. Small steps
give kappa = p a f and q = p a^2 F(1-F), the linearised estimator; large ones a noise that fills the
bounds, pulled off its mean. One model thus covers both and the transient is no unknown.

The law depends on z, the value the group agrees on, which itself is random: every coefficient is
its average over the predicted Gaussian law of the sender's z (statistical linearisation).

All is computed in units of the noise, as in the library, and handed out in the paper's.

Neglected: the dependence of a link's being on upon its past and upon the other links' (only the
shares p and, for noise common to two links, the share of steps with both on come in), which is of
the order of gain times mixing time of the chain; within the bounds, how an estimate follows a
moving z other than by one exponential; moments above the second. `valid_from` is the step from
which that is small: the bounds no longer form the estimates, what they did is mostly forgotten,
and the chain is fast against the gains.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.linalg import block_diag, eig, null_space, solve_continuous_lyapunov
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu
from scipy.special import ndtr

from . import network as networks
from .system import System

# A recursion's gains are held over this share of t; its second order is what is lost.
BLOCK = 1 / 100
# Large groups take longer blocks, because each costs the cube of the number of unknowns.
LARGE_BLOCK = 1 / 25
LARGE = 150
# The bounds are left where the estimate's variance is this near to that of one without bounds.
BOUNDS_TOLERANCE = 0.1
# Gain times mixing time of the Markov chain below which its correlation is neglected.
CHAIN_TOLERANCE = 0.1
# What the bounded phase left in the mean square must have fallen to this share: there the model
# takes the estimates' law as settled, which they only follow.
START_TOLERANCE = 1 / 3
# Grid of the estimator's law: its own states, values of z, steps a decade.
LAW_STATES, LAW_VALUES, LAW_STEPS = 140, 17, 10


def density(u):
    return np.exp(-np.square(u) / 2) / math.sqrt(2 * math.pi)


def estimator_law(step, value, threshold, bound):
    """Stationary mean, variance and sum of autocovariances of the projected estimate of a constant.

    In units of the noise, for zhat' = clamp(zhat + step (F(c - zhat) - s), -M, +M).
    """
    probability = ndtr(threshold - value)
    deviation = math.sqrt(
        step * probability * ndtr(value - threshold) / (2 * density(threshold - value))
    )
    # The grid covers the bounds or, where the law is narrower, the law.
    low = max(-bound, value - 9 * deviation)
    high = min(bound, value + 9 * deviation)
    grid, spacing = np.linspace(low, high, LAW_STATES, retstep=True)
    states = np.arange(LAW_STATES)
    entries = [(np.ones(LAW_STATES), states, states)]
    for weight, bit in ((probability, 1), (1 - probability, 0)):
        place = (np.clip(grid + step * (ndtr(threshold - grid) - bit), low, high) - low) / spacing
        # Lagrange's weights of four grid points keep mean and variance of a step between them.
        first = np.clip(np.floor(place).astype(int) - 1, 0, LAW_STATES - 4)
        u = place - first
        for offset, share in enumerate(
            (
                -(u - 1) * (u - 2) * (u - 3) / 6,
                u * (u - 2) * (u - 3) / 2,
                -u * (u - 1) * (u - 3) / 2,
                u * (u - 1) * (u - 2) / 6,
            )
        ):
            entries.append((-weight * share, states, first + offset))
    # I - T with its last column replaced by ones is regular. It gives the stationary law, and with
    # the last potential 0 the solution of Poisson's equation, whose constant there is 0 too. One
    # sparse factorisation does both, faster than the dense one and on one processor.
    values, rows, columns = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    kept = columns < LAW_STATES - 1
    values = np.concatenate([values[kept], np.ones(LAW_STATES)])
    rows = np.concatenate([rows[kept], states])
    columns = np.concatenate([columns[kept], np.full(LAW_STATES, LAW_STATES - 1)])
    factors = splu(csc_array((values, (rows, columns)), shape=(LAW_STATES, LAW_STATES)))
    law = factors.solve((states == LAW_STATES - 1).astype(float), trans="T")
    mean = law @ grid
    centred = grid - mean
    variance = law @ centred**2
    potential = factors.solve(centred)
    potential[-1] = 0
    return mean, variance, 2 * (law * centred) @ potential - variance


class EstimatorLaw:
    """`estimator_law` tabulated over step and z, as ratios to the linearised estimator's."""

    def __init__(self, threshold, bound):
        self.threshold, self.bound = threshold, bound
        # Closer towards the bounds, where the law changes fastest.
        values = bound * np.sin(np.pi / 2 * np.linspace(-1, 1, LAW_VALUES))
        slope, variance = density(threshold - values), self._bit_variance(values)
        # Below the smallest step the bounds are twenty deviations wide, above the largest one
        # each bit sends the estimate from bound to bound.
        self.smallest = np.min(2 * slope / variance) * (bound / 20) ** 2
        self.largest = 2 * bound / min(ndtr(threshold - bound), ndtr(-threshold - bound))
        decades = math.log10(self.largest / self.smallest)
        steps = np.geomspace(self.smallest, self.largest, math.ceil(LAW_STEPS * decades) + 1)
        table = np.array([[estimator_law(a, z, threshold, bound) for z in values] for a in steps])
        means, variances, sums = np.moveaxis(table, 2, 0)
        linear = steps[:, None] * variance / (2 * slope)
        logarithms = np.log(steps)
        self._bias = RectBivariateSpline(logarithms, values, means - values)
        self._variance = RectBivariateSpline(logarithms, values, np.log(variances / linear))
        sums = np.maximum(sums * slope**2 / variance, 1e-12)
        self._sum = RectBivariateSpline(logarithms, values, np.log(sums))

    def _bit_variance(self, value):
        return ndtr(self.threshold - value) * ndtr(value - self.threshold)

    def linear(self, step, value):
        """Variance, and sum of autocovariances, of the linearised estimate for a small step."""
        slope, variance = density(self.threshold - value), self._bit_variance(value)
        return step * variance / (2 * slope), variance / slope**2

    def __call__(self, step, value):
        """Mean, its derivative by z, variance and sum of autocovariances."""
        variance, total = self.linear(step, value)
        if step < self.smallest:
            # Exact for the linear recursion in discrete time.
            variance = variance / (1 - step * density(self.threshold - value) / 2)
            return value, np.ones_like(value), variance, total
        place = math.log(min(step, self.largest))
        variance = variance * min(1, self.largest / step)
        return (
            value + self._bias.ev(place, value),
            1 + self._bias.ev(place, value, dy=1),
            variance * np.exp(self._variance.ev(place, value)),
            total * np.exp(self._sum.ev(place, value)),
        )


# The law depends on threshold and bound alone: a search over beta and gamma computes it once.
estimator_law_of = lru_cache(maxsize=8)(EstimatorLaw)


@dataclass
class LinkInformation:
    """How much of its bits' information a link's estimator keeps, for a constant z."""

    sender: int
    receiver: int
    share: float  # of the steps in which the link is on
    information: float  # Fisher information of one bit at the agreed value
    variance: float  # limit of t * variance of the estimate
    bound: float  # limit of t * Cramer-Rao bound of the bits received so far
    best_beta: float  # the beta that reaches the bound: 1/f for a link that is always on

    @property
    def ratio(self):
        return self.variance / self.bound


@dataclass
class Prediction:
    """What the linear model says of a run; in the paper's units, a row as in mse.csv."""

    name: str
    mode: str
    row_steps: list[int]
    t: np.ndarray
    mse: np.ndarray  # mean over agents of E ||x_i - mean of x||^2
    estimate_mse: np.ndarray  # mean over directed links of E (zhat_ij - K2 x_j)^2
    agreed_mean: float  # mean, over runs, of the group's mean of K2 x after the last step
    agreed_deviation: float  # and its standard deviation
    bounds_left: int | None  # step from which the bounds no longer form the estimates
    start_forgotten: int | None  # step from which little is left of what happened before
    chain_mixed: int  # step from which the Markov chain is fast against the gains
    valid_from: int | None  # from this step on the prediction holds; None: not within these steps
    limit: float  # lim t * mse; infinite where the rate 1/t is not reached
    estimate_limit: float  # lim t * estimate_mse
    slowest_rate: float  # what is left of the start falls as t^-slowest_rate
    links: list[LinkInformation]


def recorded_steps(steps):
    """The rows of mse.csv: 0, round(10^(j/20)), the last."""
    last = math.floor(20 * math.log10(max(steps, 1))) + 1
    rows = {math.floor(10 ** (j / 20) + 0.5) for j in range(last + 1)}
    return [0, *sorted(row for row in rows if row < steps), steps] if steps else [0]


class Network:
    """Who hears whom, how often, and how much of the noise two links share."""

    def __init__(self, system: System):
        links = system.links
        self.agents, self.count = system.agents, len(links)
        self.sender = np.array([a - 1 for a, _ in links])
        self.receiver = np.array([b - 1 for _, b in links])
        transition = np.atleast_2d(np.asarray(system.transition, dtype=float))
        stationary = networks.stationary(transition)
        edges = [{frozenset(edge) for edge in graph} for graph in system.graphs]
        active = np.array([[frozenset(link) in graph for link in links] for graph in edges], float)
        self.share = stationary @ active
        together = (active.T * stationary) @ active
        if system.mode == "broadcast":
            same_noise = self.sender[:, None] == self.sender
        else:
            same_noise = np.eye(self.count, dtype=bool)
        scale = np.sqrt(self.share)
        self.correlation = np.where(same_noise, together / np.outer(scale, scale), 0)
        self.hears = np.zeros((self.agents, self.count))
        self.hears[self.receiver, np.arange(self.count)] = self.share
        self.degree = self.hears.sum(axis=1)
        self.largest_degree = max(system.laplacian(k).diagonal().max() for k in range(len(edges)))
        moduli = sorted(np.abs(np.linalg.eigvals(transition)), reverse=True)
        # Steps in which the chain forgets, by its second eigenvalue; a single graph has none.
        self.mixing = 1 / max(1 - moduli[1], 1e-12) if len(moduli) > 1 else 0.0

    def senders_of(self):
        """The matrix that picks each link's sender from a vector over the agents."""
        return np.eye(self.agents)[self.sender]


@dataclass
class Plant:
    """One agent's closed loop; `row` gives z in units of the noise, `gram` the norm of a state."""

    closed: np.ndarray
    input: np.ndarray
    row: np.ndarray
    gram: np.ndarray


def agreement_direction(system: System):
    """Eigenvalue nearest to 1 of A + B K1 with its right vector v1, K2 v1 = 1, and its left one."""
    closed = system.A + np.outer(system.B, system.K1)
    values, left, right = eig(closed, left=True, right=True)
    place = np.argmin(np.abs(values - 1))
    right = np.real(right[:, place])
    right = right / (system.K2 @ right)
    left = np.real(left[:, place])
    moduli = np.delete(np.abs(values), place)
    return np.real(values[place]), right, left / (left @ right), max(moduli, default=0.0)


def full_plant(system: System):
    closed = system.A + np.outer(system.B, system.K1)
    # The control's sum is in units of the noise inside and in the paper's at the plant's input.
    return Plant(closed, system.B * system.sigma, system.K2 / system.sigma, np.eye(len(system.B)))


def slow_plant(system: System):
    """The filter along v1 alone, once what the noise excites in the stable modes is negligible."""
    value, right, left, _ = agreement_direction(system)
    return Plant(
        np.array([[value]]),
        np.array([left @ system.B * system.sigma]),
        np.array([1 / system.sigma]),
        np.array([[right @ right]]),
    ), left[None, :]


class Moments:
    """Mean and covariance of (x_1 .. x_N, zhat of all links) and their recursion."""

    def __init__(self, system: System, network: Network):
        self.system, self.network = system, network
        self.law = estimator_law_of(system.threshold / system.sigma, system.bound / system.sigma)
        estimates = np.full(network.count, system.initial_estimate / system.sigma)
        states = np.asarray(system.initial_states, dtype=float).ravel()
        self.mean = np.concatenate([states, estimates])
        self.covariance = np.zeros((len(self.mean), len(self.mean)))
        self._use(full_plant(system))
        nodes, weights = np.polynomial.hermite_e.hermegauss(5)
        self._nodes, self._weights = nodes, weights / weights.sum()

    def _use(self, plant):
        agents = np.eye(self.network.agents)
        self.plant = plant
        self.size = self.network.agents * len(plant.input)
        self.rows = np.kron(agents, plant.row)
        self.closed = np.kron(agents, plant.closed)
        self.inputs = np.kron(agents, plant.input[:, None])
        centring = agents - 1 / self.network.agents
        self.gram = np.kron(centring, plant.gram) / self.network.agents

    def mse(self):
        states, covariance = self.mean[: self.size], self.covariance[: self.size, : self.size]
        return float(states @ self.gram @ states + np.sum(self.gram * covariance))

    def estimate_mse(self):
        to_error = np.hstack([-self.rows[self.network.sender], np.eye(self.network.count)])
        error = to_error @ self.mean
        variance = np.sum((to_error @ self.covariance) * to_error, axis=1)
        return float(np.mean(error**2 + variance)) * self.system.sigma**2

    def values(self):
        """Mean and covariance of every agent's z, in units of the noise."""
        block = self.covariance[: self.size, : self.size]
        return self.rows @ self.mean[: self.size], self.rows @ block @ self.rows.T

    def over_values(self, function):
        """Averages over each agent's Gaussian law of z of the arrays that `function` returns."""
        mean, covariance = self.values()
        deviation = np.sqrt(np.maximum(np.diag(covariance), 0))
        # Within the bounds, as K2 x stays there with the estimates that move it.
        points = mean[:, None] + deviation[:, None] * self._nodes
        points = np.clip(points, -self.law.bound, self.law.bound)
        averages = (np.reshape(array, points.shape) for array in function(points.ravel()))
        return [average @ self._weights for average in averages]

    def step_size(self, t):
        return self.system.beta / self.system.sigma / t

    def bounds_influence(self, t):
        """Largest relative difference that the bounds make to an estimate's variance."""
        step = self.step_size(t)
        _, _, variance, _ = self.over_values(lambda z: self.law(step, z))
        linear, _ = self.over_values(lambda z: self.law.linear(step, z))
        return float(np.max(np.abs(variance / linear - 1)))

    def advance(self, t, count):
        """`count` steps from clock `t` on with one average gain: powers of the map by doubling."""
        network, size = self.network, self.size
        estimator = self.step_size(1 / np.mean(1 / np.arange(t, t + count)))
        control = self.system.gamma * np.mean(1 / np.arange(t + 1, t + count + 1))
        heard = self.over_values(lambda z: self.law(estimator, z))
        target, slope, variance, total = (array[network.sender] for array in heard)
        # The linear estimate with the variance V and, as the control hears it in a share p of the
        # steps, the noise p S at low frequencies: p^2 V (2 - kappa)/kappa = p S.
        kappa = 2 * network.share * variance / (total + network.share * variance)
        noise = variance * kappa * (2 - kappa)
        sent = self.rows[network.sender]
        centre = sent @ self.mean[:size]

        to_estimates = np.hstack([(kappa * slope)[:, None] * sent, np.diag(1 - kappa)])
        drift_estimates = kappa * (target - slope * centre)
        from_estimates = control * self.inputs @ network.hears
        step = np.zeros((len(self.mean), len(self.mean)))
        step[size:] = to_estimates
        # The control uses the estimates of the same step.
        step[:size] = from_estimates @ to_estimates
        step[:size, :size] += self.closed
        step[:size, :size] -= control * self.inputs @ (network.degree[:, None] * self.rows)
        drift = np.concatenate([from_estimates @ drift_estimates, drift_estimates])
        enters = np.vstack([from_estimates, np.eye(network.count)])
        added = enters @ (network.correlation * np.sqrt(np.outer(noise, noise))) @ enters.T
        while True:
            if count & 1:
                self.mean = step @ self.mean + drift
                self.covariance = step @ self.covariance @ step.T + added
            count >>= 1
            if not count:
                return
            added = step @ added @ step.T + added
            drift = step @ drift + drift
            step = step @ step

    def reduce(self, tolerance):
        """Keep of each agent's state its part along v1, if the rest no longer counts."""
        plant, left = slow_plant(self.system)
        projection = block_diag(
            np.kron(np.eye(self.network.agents), left), np.eye(self.network.count)
        )
        full, kept = self.mse(), (self.plant, self.mean, self.covariance)
        self.mean = projection @ self.mean
        self.covariance = projection @ self.covariance @ projection.T
        self._use(plant)
        if abs(self.mse() - full) > tolerance * full:
            plant, self.mean, self.covariance = kept
            self._use(plant)


def limits(moments: Moments):
    """Limits of t * mse and t * estimate_mse, and the rate at which the start is forgotten.

    In s = log t and with the estimates' errors e = zhat - z_j and the differences y of the z, the
    covariance P of (y, e) for small gains obeys d(tP)/ds = (H + I/2) tP + tP (H + I/2)' + Q.
    """
    system, network = moments.system, moments.network
    variance, total = moments.over_values(lambda z: moments.law.linear(1, z))
    variance, total = variance[network.sender], total[network.sender]
    rate = 2 * network.share * variance / total * system.beta / system.sigma
    intensity = 2 * rate * variance * system.beta / system.sigma
    sender = network.senders_of()
    laplacian = np.diag(network.degree) - network.hears @ sender
    differences = null_space(np.ones((1, network.agents)))
    moved_by = np.hstack([-laplacian @ differences, network.hears]) * system.gamma
    drift = np.vstack([differences.T @ moved_by, -sender @ moved_by])
    apart = network.agents - 1
    drift[apart:, apart:] -= np.diag(rate)
    slowest = float(-np.max(np.real(np.linalg.eigvals(drift))))
    if slowest <= 0.5:
        return math.inf, math.inf, slowest
    noise = np.zeros_like(drift)
    noise[apart:, apart:] = network.correlation * np.sqrt(np.outer(intensity, intensity))
    covariance = solve_continuous_lyapunov(drift + np.eye(len(drift)) / 2, -noise)
    _, right, _, _ = agreement_direction(system)
    unit = system.sigma**2
    mse = np.trace(covariance[:apart, :apart]) / network.agents * (right @ right) * unit
    return float(mse), float(np.mean(np.diag(covariance)[apart:])) * unit, slowest


def link_information(system: System, value: float):
    """Each link's estimator against the Cramer-Rao bound of its bits, for z = `value`.

    With the link on in a share p of the steps, t * variance of zhat goes to
    p beta^2 F(1-F) / (2 p beta f - 1), and no unbiased estimate from the p t bits received falls
    below F(1-F) / (p f^2 t). The quotient is (p beta f)^2 / (2 p beta f - 1): 1 at beta = 1/(p f).
    """
    network = Network(system)
    u = (system.threshold - value) / system.sigma
    slope, variance = density(u) / system.sigma, ndtr(u) * ndtr(-u)
    figures = []
    for (sender, receiver), share in zip(system.links, network.share, strict=True):
        excess = 2 * share * system.beta * slope - 1
        reached = share * system.beta**2 * variance / excess if excess > 0 else math.inf
        figures.append(
            LinkInformation(
                sender,
                receiver,
                float(share),
                float(slope**2 / variance),
                float(reached),
                float(variance / (share * slope**2)),
                float(1 / (share * slope)),
            )
        )
    return figures


def predict(system: System, steps: int) -> Prediction:
    """Mean square disagreement and estimation error at the rows of mse.csv, and where they hold.

    Costs the cube of (agents + links) times the logarithm of `steps`: under a second for ten
    agents, after one more for the estimator's law of a new threshold or bound.
    """
    network = Network(system)
    moments = Moments(system, network)
    block = LARGE_BLOCK if len(moments.mean) > LARGE else BLOCK
    _, _, _, stable = agreement_direction(system)
    settled = max(100, math.ceil(20 / max(1 - stable, 1e-6)))
    rows = recorded_steps(steps)
    mse, estimate_mse, influence = [], [], []
    done = 0
    for row in rows:
        while done < row:
            t = system.t0 + 1 + done
            count = min(row - done, max(1, int(block * t)))
            moments.advance(t, count)
            done += count
        mse.append(moments.mse())
        estimate_mse.append(moments.estimate_mse())
        influence.append(moments.bounds_influence(system.t0 + row))
        if row > settled and moments.size > network.agents:
            moments.reduce(tolerance=1e-4)

    mean, covariance = moments.values()
    value = float(np.clip(mean.mean(), -moments.law.bound, moments.law.bound)) * system.sigma
    links = link_information(system, value)
    confined = [row for row, size in zip(rows, influence, strict=True) if size > BOUNDS_TOLERANCE]
    free = [row for row in rows if not confined or row > confined[-1]]
    bounds_left = free[0] if free else None
    limit, estimate_limit, slowest = limits(moments)
    start_forgotten = None
    # A mode's mean square falls as t^-(2 rate); a slow enough one is never forgotten in 32 bits.
    longer = START_TOLERANCE ** (-0.5 / max(slowest, 0.02))
    if free:
        start_forgotten = math.ceil((system.t0 + 1 + bounds_left) * longer) - system.t0 - 1
    # The gains in question: of the estimates, beta f at the agreed value, and of the control.
    slope = density((system.threshold - value) / system.sigma) / system.sigma
    gain = max(system.beta * slope, system.gamma * network.largest_degree)
    chain_mixed = max(0, math.ceil(gain * network.mixing / CHAIN_TOLERANCE) - system.t0 - 1)
    valid_from = None
    if free:
        begins = max(start_forgotten, chain_mixed)
        valid_from = next((row for row in free if row >= begins), None)
    return Prediction(
        name=system.name,
        mode=system.mode,
        row_steps=rows,
        t=system.t0 + 1 + np.array(rows, dtype=float),
        mse=np.array(mse),
        estimate_mse=np.array(estimate_mse),
        agreed_mean=value,
        agreed_deviation=math.sqrt(max(covariance.mean(), 0)) * system.sigma,
        bounds_left=bounds_left,
        start_forgotten=start_forgotten,
        chain_mixed=chain_mixed,
        valid_from=valid_from,
        limit=limit,
        estimate_limit=estimate_limit,
        slowest_rate=slowest,
        links=links,
    )


def draw(prediction: Prediction, rows, path):
    """The prediction over a simulated ensemble with its confidence band, as a deterministic SVG.

    `rows`: dictionaries with the columns step, t, mse, mse_se of an mse.csv, text or numbers.
    """
    import matplotlib.pyplot as plt
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
    from plot import F64_COLOUR, FIT_COLOUR, Q31_COLOUR, new_axes, power_of_ten

    title = f"{prediction.name}: predicted and simulated disagreement"
    figure, axes = new_axes(title)
    t, mse = (np.array([float(row[name]) for row in rows]) for name in ("t", "mse"))
    # One run has no standard error.
    error = np.array([float(row.get("mse_se") or "nan") for row in rows])
    if np.isfinite(error).any():
        # An edge at or below zero has no logarithm: the band then reaches far down.
        lower = np.maximum(mse - 2 * error, mse * 1e-3)
        band = {"color": F64_COLOUR, "alpha": 0.22, "linewidth": 0, "zorder": 1}
        axes.fill_between(t, lower, mse + 2 * error, label="± 2 standard errors", **band)
    axes.plot(t, mse, color=F64_COLOUR, linewidth=1.2, zorder=2, label="simulated ensemble")
    steps = np.array(prediction.row_steps)
    from_here = steps >= prediction.valid_from if prediction.valid_from is not None else steps < 0
    # Dark dashes over the light band: apart on paper without colour too.
    early = {"color": FIT_COLOUR, "linewidth": 1.0, "linestyle": (0, (1, 2)), "zorder": 3}
    solid = {"color": FIT_COLOUR, "linewidth": 1.8, "linestyle": (0, (5, 2)), "zorder": 4}
    if not from_here.all():
        # One point on, so that the two parts of the line meet.
        until = np.flatnonzero(~from_here)[-1] + 2
        label = "prediction, where it need not hold"
        axes.plot(prediction.t[:until], prediction.mse[:until], label=label, **early)
    if from_here.any():
        label = f"prediction, holds from step {prediction.valid_from:,}"
        axes.plot(prediction.t[from_here], prediction.mse[from_here], label=label, **solid)
        axes.axvline(prediction.t[from_here][0], color="#777777", linewidth=0.8, zorder=1)
    if math.isfinite(prediction.limit) and from_here.any():
        ends = np.array([prediction.t[from_here][0], prediction.t[-1]])
        look = {"color": Q31_COLOUR, "linewidth": 1.4, "linestyle": "-.", "zorder": 2}
        axes.plot(ends, prediction.limit / ends, label=f"limit {prediction.limit:.4g} / t", **look)
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(numticks=20))
        axis.set_major_formatter(FuncFormatter(power_of_ten))
        axis.set_minor_formatter(NullFormatter())
    axes.set_ylim(bottom=axes.get_ylim()[0] / 2)  # room for the legend under the curve
    axes.set_xlabel("clock t")
    axes.set_ylabel("mean square disagreement")
    axes.legend(loc="lower left", handlelength=2.8)
    generator = "tools/onebit_design/prediction.py"
    metadata = {"Creator": generator, "Date": None, "Title": title}
    figure.savefig(Path(path), format="svg", facecolor="white", metadata=metadata)
    plt.close(figure)


def report_lines(prediction: Prediction) -> list[str]:
    """The prediction in words, for the terminal."""
    last, clock = prediction.row_steps[-1], prediction.t[-1]
    lines = [
        f"after {last:,} steps: mean square disagreement {prediction.mse[-1]:.4g}, "
        f"of the estimates {prediction.estimate_mse[-1]:.4g}",
        f"agreed value of K2 x: mean {prediction.agreed_mean:.4g}, "
        f"standard deviation over runs {prediction.agreed_deviation:.2g}",
    ]
    if math.isfinite(prediction.limit):
        share = clock * prediction.mse[-1] / prediction.limit
        lines.append(
            f"t * disagreement goes to {prediction.limit:.4g} (after {last:,} steps: "
            f"{100 * share:.0f} % of it), t * estimation error to {prediction.estimate_limit:.4g}"
        )
        lines.append(
            "what is left of the start falls as "
            f"t^-{2 * prediction.slowest_rate:.3g} in the mean square"
        )
    else:
        lines.append(
            "the rate 1/t is not reached: the slowest mode falls as "
            f"t^-{prediction.slowest_rate:.3g}, which must be faster than t^-0.5"
        )
    if prediction.valid_from is not None:
        lines.append(f"the prediction holds from step {prediction.valid_from:,} on")
    else:
        lines.append(f"the prediction does not yet hold within {last:,} steps")
    if prediction.bounds_left is None:
        lines.append(f"  the estimators do not leave their bounds within {last:,} steps")
    else:
        lines.append(
            f"  from step {prediction.bounds_left:,} the bounds change the estimates' variance by "
            f"less than {100 * BOUNDS_TOLERANCE:.0f} %"
        )
        lines.append(
            f"  from step {prediction.start_forgotten:,} less than "
            f"{100 * START_TOLERANCE:.0f} % is left of what happened before that"
        )
    if prediction.chain_mixed:
        lines.append(
            f"  from step {prediction.chain_mixed:,} a step's gain times the mixing time of the "
            f"Markov chain is below {CHAIN_TOLERANCE:g}"
        )
    lines.append(
        f"estimators against the Cramer-Rao bound of their bits, for a constant K2 x = "
        f"{prediction.agreed_mean:.4g} (limits of t * variance):"
    )
    # Links alike in all figures stand on one line.
    groups = {}
    for link in prediction.links:
        figures = (link.share, link.variance, link.bound, link.best_beta)
        figures = tuple(f"{figure:.9g}" for figure in figures)
        groups.setdefault(figures, []).append(link)
    for links in groups.values():
        link = links[0]
        names = ", ".join(f"{one.sender}>{one.receiver}" for one in links)
        lines.append(
            f"  {link.variance:.4g} against {link.bound:.4g}, {link.ratio:.4g} times the bound; "
            f"1 at beta = {link.best_beta:.4g}; on in {100 * link.share:.3g} % of the steps: "
            f"{names}"
        )
    return lines
