"""The algorithm a second time, straight from the paper's equations, to check the C code with.

Nothing here is shared with `lib/` or `sim/`. The paper's own units are kept, `sigma` where the
paper has it, while the library divides every compressed quantity by `sigma`. Equations are named by
their labels in the paper: (MAS), (binary), (estimate), (piM), (control), Algorithm 1.

Every function takes one network or many: leading axes of the arrays are independent runs.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

# NumPy has no error function, and an ensemble needs one on arrays: SciPy's normal distribution F.
from scipy.special import ndtr


@dataclass(frozen=True)
class Scenario:
    """A scenario file, with the links of the union numbered by sender, then receiver."""

    A: np.ndarray
    B: np.ndarray
    K1: np.ndarray
    K2: np.ndarray
    beta: float
    gamma: float
    t0: int
    threshold: float  # c
    bound: float  # M
    sigma: float  # the noise's standard deviation, delta in Assumption 2
    transition: np.ndarray
    states: np.ndarray  # x_i(t0+1), one row an agent
    estimates: float  # zhat_ij(t0)
    broadcast: bool
    identifier_base: int
    fixed: dict
    senders: np.ndarray  # j of each directed link, from 0
    receivers: np.ndarray  # i of each directed link, from 0
    heard: np.ndarray  # one row a graph, one column a link: is the link in the graph?
    incidence: np.ndarray  # one row a link, one column an agent: 1 at the link's receiver

    @property
    def agents(self):
        return len(self.states)

    @property
    def links(self):
        return len(self.senders)


def read_scenario(path):
    """The numbers of a well-formed scenario file; refusing bad ones is the simulator's work."""
    tree = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    plant, gains, topology = tree["plant"], tree["gains"], tree["topology"]
    graphs = []
    for graph in topology["graphs"]:
        edges = [tuple(edge) for edge in graph["edges"]]
        graphs.append(set(edges) | {(j, i) for i, j in edges})
    links = sorted(set().union(*graphs))
    states = np.array(tree["initial"]["states"], dtype=float)
    receivers = np.array([receiver - 1 for _, receiver in links])
    return Scenario(
        A=np.array(plant["A"], dtype=float),
        B=np.array(plant["B"], dtype=float),
        K1=np.array(gains["stabilizing"], dtype=float),
        K2=np.array(gains["compression"], dtype=float),
        beta=float(gains["beta"]),
        gamma=float(gains["gamma"]),
        t0=int(gains["t0"]),
        threshold=float(tree["quantizer"]["threshold"]),
        bound=float(tree["quantizer"]["bound"]),
        sigma=float(tree["noise"]["sigma"]),
        transition=np.array(topology.get("transition", [[1]]), dtype=float),
        states=states,
        estimates=float(tree["initial"].get("estimates", 0)),
        broadcast=tree.get("channel", {}).get("mode", "link") == "broadcast",
        identifier_base=int(tree.get("bus", {}).get("base", 0x100)),
        fixed=tree.get("fixed", {}),
        senders=np.array([sender - 1 for sender, _ in links]),
        receivers=receivers,
        heard=np.array([[link in graph for link in links] for graph in graphs]),
        incidence=np.eye(len(states))[receivers],
    )


# Algorithm 1, one step.


def estimate(scenario, estimates, bits, heard, t):
    """(estimate) with the projection (piM): zhat_ij(t) from zhat_ij(t-1) and the bit s_ij(t)."""
    distribution = ndtr((scenario.threshold - estimates) / scenario.sigma)
    moved = estimates + scenario.beta / t * (distribution - bits)
    projected = np.minimum(np.maximum(moved, -scenario.bound), scenario.bound)
    return np.where(heard, projected, estimates)


def control(scenario, states, estimates, heard, t):
    """(control): u_i(t), the sum over the neighbours heard at t."""
    compressed = states @ scenario.K2
    differences = (estimates - compressed.take(scenario.receivers, axis=-1)) * heard
    consensus = differences @ scenario.incidence
    return states @ scenario.K1 + scenario.gamma / (t + 1) * consensus


def plant(scenario, states, controls):
    """(MAS): x_i(t+1)."""
    return states @ scenario.A.T + controls[..., np.newaxis] * scenario.B


# The Markov chain over graphs.


def stationary_law(transition):
    """pi with pi P = pi and sum 1; unique, as the chain is irreducible."""
    size = len(transition)
    equations = np.vstack([transition.T - np.eye(size), np.ones(size)])
    return np.linalg.lstsq(equations, np.append(np.zeros(size), 1.0), rcond=None)[0]


class Chain:
    """Graph numbers (from 0) by inversion of uniform numbers: pi first, then the graph's row."""

    def __init__(self, scenario):
        self.first = np.cumsum(stationary_law(scenario.transition))
        self.rows = np.cumsum(scenario.transition, axis=1)
        self.first[-1] = self.rows[:, -1] = np.inf  # the last graph if no other is taken

    def next(self, graph, uniform):
        """The first graph whose cumulative probability exceeds `uniform`."""
        cumulative = self.first if graph is None else self.rows[graph]
        return (cumulative > uniform).argmax(axis=-1)


# Sources of randomness: `uniform(t)` moves the chain (a number for each run, in a trailing axis of
# one where there are many), `messages(t, z)` encodes z_j = K2 x_j(t) into a bit for each link, or
# for each agent in broadcast.


class GaussianNoise:
    """(binary) as it stands: y = K2 x + d with Gaussian d, s = 1{y <= c}. `runs` is () or (R,)."""

    BLOCK = 256  # steps drawn at once, since a call to the generator costs more than its numbers

    def __init__(self, scenario, seed, runs=()):
        self.scenario = scenario
        self.generator = np.random.default_rng(seed)
        width = scenario.agents if scenario.broadcast else scenario.links
        self.shape = (self.BLOCK, *runs, width)
        self.runs = runs
        self.drawn = self.BLOCK

    def uniform(self, t):
        return self.generator.random((*self.runs, 1))

    def messages(self, t, compressed):
        if self.drawn == self.BLOCK:
            self.noise = self.generator.normal(0.0, self.scenario.sigma, self.shape)
            self.drawn = 0
        sent = compressed
        if not self.scenario.broadcast:
            sent = compressed.take(self.scenario.senders, axis=-1)
        received = sent + self.noise[self.drawn]
        self.drawn += 1
        return received <= self.scenario.threshold


def threefry2x32(key, counter):
    """Threefry-2x32 with 20 rounds (Salmon, Moraes, Dror, Shaw: Parallel random numbers, 2011)."""
    mask = 0xFFFFFFFF
    rotations = (13, 15, 26, 6, 17, 29, 16, 24)
    schedule = (key[0], key[1], 0x1BD11BDA ^ key[0] ^ key[1])
    first, second = (counter[0] + key[0]) & mask, (counter[1] + key[1]) & mask
    for round_number in range(1, 21):
        rotation = rotations[(round_number - 1) % 8]
        first = (first + second) & mask
        second = ((second << rotation | second >> (32 - rotation)) & mask) ^ first
        if round_number % 4 == 0:
            injection = round_number // 4
            first = (first + schedule[injection % 3]) & mask
            second = (second + schedule[(injection + 1) % 3] + injection) & mask
    return first, second


class LibraryWords:
    """The library's random words: bit = (word >> 1) < F * 2^31, equal in law to (binary)."""

    def __init__(self, scenario, seed, run):
        self.scenario = scenario
        self.key = (seed, run)

    def word(self, link, t):
        return threefry2x32(self.key, (link, t))[0]

    def uniform(self, t):
        return (self.word(0, t) >> 1) / 2**31  # link 0 is the chain

    def messages(self, t, compressed):
        sent = compressed if self.scenario.broadcast else compressed[self.scenario.senders]
        ones = ndtr((self.scenario.threshold - sent) / self.scenario.sigma) * 2**31
        words = [self.word(link, t) >> 1 for link in range(1, len(sent) + 1)]
        return np.array(words) < ones


@dataclass
class Step:
    """What happened at t; `messages` as sent, `bits` as they reach the links of the union."""

    t: int
    states: np.ndarray  # x_i(t)
    messages: np.ndarray
    bits: np.ndarray  # s_ij(t)
    heard: np.ndarray
    estimates: np.ndarray  # zhat_ij(t)
    controls: np.ndarray  # u_i(t)
    next_states: np.ndarray  # x_i(t+1)


def simulate(scenario, source, steps, runs=()):
    """Closed loop of Algorithm 1 from t = t0+1: yields a Step each time."""
    chain, graph = Chain(scenario), None
    heard = scenario.heard[0]  # for good if there is one graph
    states = np.broadcast_to(scenario.states, (*runs, *scenario.states.shape))
    estimates = np.full((*runs, scenario.links), scenario.estimates)
    for t in range(scenario.t0 + 1, scenario.t0 + 1 + steps):
        if len(scenario.heard) > 1:
            graph = chain.next(graph, source.uniform(t))
            heard = scenario.heard[graph]
        messages = source.messages(t, states @ scenario.K2)
        bits = messages[..., scenario.senders] if scenario.broadcast else messages
        estimates = estimate(scenario, estimates, bits, heard, t)
        controls = control(scenario, states, estimates, heard, t)
        next_states = plant(scenario, states, controls)
        yield Step(t, states, messages, bits, heard, estimates, controls, next_states)
        states = next_states


def errors(scenario, states, estimates, completed):
    """The three errors of `mse.csv` for each run, after `completed` steps: disagreement, estimation
    error over the links of the union, and departure from where the initial average would be."""
    disagreement = states - states.mean(axis=-2, keepdims=True)
    estimation = estimates - (states @ scenario.K2)[..., scenario.senders]
    closed_loop = scenario.A + np.outer(scenario.B, scenario.K1)
    average = np.linalg.matrix_power(closed_loop, completed) @ scenario.states.mean(axis=0)
    departure = states - average
    return {
        "mse": (disagreement**2).sum(axis=-1).mean(axis=-1),
        "estimate_mse": (estimation**2).mean(axis=-1),
        "average_error": (departure**2).sum(axis=-1).mean(axis=-1),
    }
