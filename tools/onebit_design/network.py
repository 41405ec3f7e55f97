"""Who hears whom: graphs by family or file, their components, and the chain that switches them."""

from math import gcd
from pathlib import Path

import networkx
import numpy as np

Edge = tuple[int, int]


def edges_of(graph: networkx.Graph) -> list[Edge]:
    """Edges with agents counted from 1, in the order of the graph's own nodes."""
    numbers = {node: number for number, node in enumerate(sorted(graph), 1)}
    return sorted(tuple(sorted((numbers[a], numbers[b]))) for a, b in graph.edges)


# Families that take one number of agents, and the least that makes sense.
FAMILIES = {
    "ring": (3, networkx.cycle_graph),
    "complete": (2, networkx.complete_graph),
    "path": (2, networkx.path_graph),
    # Agent 1 is the hub; networkx counts the leaves.
    "star": (2, lambda agents: networkx.star_graph(agents - 1)),
}


def family(name: str, agents: int) -> list[Edge]:
    return edges_of(FAMILIES[name][1](agents))


def grid(rows: int, columns: int) -> list[Edge]:
    """Agents row by row, each linked with those beside, above and below it."""
    return edges_of(networkx.grid_2d_graph(rows, columns))


def random_regular(agents: int, degree: int, seed: int) -> list[Edge]:
    return edges_of(networkx.random_regular_graph(degree, agents, seed=seed))


class EdgeListError(Exception):
    """A line of an edge-list file that is not two agents; `line` counts from 1."""

    def __init__(self, line: int, text: str):
        super().__init__(text)
        self.line = line


def edge_list(path: Path) -> list[tuple[Edge, int]]:
    """Edges and their lines of a file with two agent numbers a line; blank lines and what follows
    # are skipped."""
    edges = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if len(words) != 2 or not all(word.isascii() and word.isdigit() for word in words):
            raise EdgeListError(number, f"must be two agent numbers, not '{line.strip()}'")
        edges.append(((int(words[0]), int(words[1])), number))
    return edges


def components(agents: int, graphs: list[list[Edge]]) -> list[list[int]]:
    """Connected components of the graphs' union, each ascending, by their first agents."""
    union = networkx.Graph()
    union.add_nodes_from(range(1, agents + 1))
    for edges in graphs:
        union.add_edges_from(edges)
    return sorted(sorted(part) for part in networkx.connected_components(union))


def chain_graph(transition: np.ndarray) -> networkx.DiGraph:
    """The chain's graphs, numbered from 1, and the transitions that are possible."""
    return networkx.relabel_nodes(
        networkx.from_numpy_array(transition > 0, create_using=networkx.DiGraph),
        lambda number: number + 1,
    )


def communicating_classes(transition: np.ndarray) -> list[list[int]]:
    """Sets of graphs that lead to each other; one set: the chain is irreducible."""
    return sorted(
        sorted(part) for part in networkx.strongly_connected_components(chain_graph(transition))
    )


def cyclic_classes(transition: np.ndarray) -> list[list[int]]:
    """The classes that an irreducible chain visits in turn; one: it is aperiodic."""
    steps = chain_graph(transition)
    # Every transition a -> b closes walks whose lengths differ by level(a) + 1 - level(b).
    level = networkx.single_source_shortest_path_length(steps, 1)
    period = 0
    for a, b in steps.edges:
        period = gcd(period, level[a] + 1 - level[b])
    classes = [[] for _ in range(period)]
    for node in sorted(level):
        classes[level[node] % period].append(node)
    return classes


def stationary(transition: np.ndarray) -> np.ndarray:
    """pi with pi P = pi and sum 1, of an irreducible chain."""
    size = len(transition)
    # One of the equations follows from the others; the sum takes its place.
    equations = transition.T - np.eye(size)
    equations[-1] = 1
    right = np.zeros(size)
    right[-1] = 1
    return np.linalg.solve(equations, right)
