"""A machine, a network and the constants of their agreement, in the paper's units."""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class System:
    """What a complete scenario says; the arrays are what every other module works on."""

    name: str
    A: np.ndarray  # n x n, discrete time
    B: np.ndarray  # n
    K1: np.ndarray  # n, stabilizing row
    K2: np.ndarray  # n, compression row
    beta: float
    gamma: float
    t0: int
    threshold: float  # c
    bound: float  # M
    sigma: float
    graphs: list[list[tuple[int, int]]]  # undirected edges a graph, agents count from 1
    transition: np.ndarray  # Markov chain over the graphs; [[1]] for one graph
    initial_states: np.ndarray  # agents x n
    initial_estimate: float
    mode: str  # link | broadcast
    bus: dict  # model, bitrate, encoding and, where given, base: as in the scenario file
    period: float  # seconds a step
    steps: int
    integer_plant: bool = False
    fixed: dict = field(default_factory=dict)  # state_fraction_bits, control_fraction_bits

    @property
    def agents(self) -> int:
        return len(self.initial_states)

    @property
    def links(self) -> list[tuple[int, int]]:
        """Directed links of the union of all graphs, sorted by sender, then receiver."""
        edges = {edge for graph in self.graphs for edge in graph}
        return sorted({(a, b) for a, b in edges} | {(b, a) for a, b in edges})

    def laplacian(self, graph: int) -> np.ndarray:
        matrix = np.zeros((self.agents, self.agents))
        for a, b in self.graphs[graph]:
            matrix[a - 1, b - 1] = matrix[b - 1, a - 1] = -1
        return matrix - np.diag(matrix.sum(axis=1))
