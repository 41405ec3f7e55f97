"""onebit-design's figures against published numbers, against the paper's matrices written out, and
against networkx."""

import math
import sys
from pathlib import Path

import networkx
import numpy as np
import pytest
import yaml
from simulator import ROOT, SCENARIOS

sys.path.insert(0, str(ROOT / "tools"))

from onebit_design import choose, conditions, gains, network, plants, reader

PRINTED_A = [
    [0.7358, 0.1839, 0, 0],
    [-0.7358, 0, 0, 0],
    [0.7073, 0.0777, 1, 0.5],
    [2.6891, 0.3964, 0, 1],
]
PRINTED_B = [0.1982, 0.5518, -0.093, -0.2668]


def computed(path):
    request = reader.read(path)
    reader.check_numbers(request)
    return request.system, conditions.compute(request.system, request.controllability)


@pytest.mark.parametrize(
    ("name", "lambda_2", "lambda_G", "alpha", "beta_consensus", "beta_rate", "pi"),
    [
        ("aircraft-fixed", 1.58579, 3, 58.1032, 498.904, 539.014, [1]),
        ("aircraft-markov", 0.528595, 1.857143, 9.977195, 1983.45, 7181.54, [1 / 3] * 3),
    ],
)
def test_both_examples_of_the_paper(name, lambda_2, lambda_G, alpha, beta_consensus, beta_rate, pi):
    """Published figures, each to the digits that were printed."""
    _, figures = computed(SCENARIOS / f"{name}.yaml")
    net = figures.network
    assert net.lambda_2 == pytest.approx(lambda_2, abs=0.5e-5)
    assert net.lambda_G == pytest.approx(lambda_G, abs=0.5e-6)
    assert net.alpha == pytest.approx(alpha, abs=0.5e-4)
    assert figures.f_M == pytest.approx(0.0604927, abs=0.5e-7)
    assert figures.beta_consensus == pytest.approx(beta_consensus, abs=0.5e-2)
    assert figures.beta_rate == pytest.approx(beta_rate, abs=0.5e-2)
    assert figures.gamma_min == pytest.approx(1 / lambda_2, rel=1e-5)
    np.testing.assert_allclose(net.pi, pi, rtol=1e-12)
    assert net.pi_min == pytest.approx(min(pi))
    assert figures.t0_min == pytest.approx({1: 2, 3: 2.4 * 2 - 1}[len(pi)])
    assert all(condition.holds for condition in figures.conditions)
    np.testing.assert_allclose(np.sort(figures.eigenvalues.real), [0.5, 0.5, 0.5, 1], atol=1e-4)


def test_gains_of_the_printed_plant():
    K1, K2 = gains.rows(np.array(PRINTED_A), np.array(PRINTED_B), [0.5, 0.5, 0.5])
    np.testing.assert_allclose(K1, [-0.9224, -0.1825, 0, -0.1788], atol=0.5e-4)
    np.testing.assert_allclose(K2, [3.8734, 0.9054, 0.3575, 0.8773], atol=0.5e-4)


def test_the_continuous_aircraft_with_the_corrected_sign():
    A, B = gains.discretize(*plants.build("aircraft", {}), 0.5)
    # The paper cuts some digits instead of rounding them.
    np.testing.assert_allclose(A, PRINTED_A, atol=1e-4)
    np.testing.assert_allclose(B, PRINTED_B, atol=1e-4)
    exact = math.exp(-1)  # both of its poles are -2: e^(-2 * 0.5)
    np.testing.assert_allclose(A[0, :2], [2 * exact, exact / 2], rtol=1e-12)
    K1, K2 = gains.rows(A, B, [0.5, 0.5, 0.5])
    # K2 of a plant that differs by rounding to four digits.
    np.testing.assert_allclose(K2, [3.8734, 0.9054, 0.3575, 0.8773], atol=2e-3)
    np.testing.assert_allclose(K1, [-0.9224, -0.1825, 0, -0.1788], atol=2e-3)
    # With the sign as the paper prints it, B_d is another one.
    wrong = gains.discretize(plants.build("aircraft", {})[0], np.array([0, 3, 0, 1]), 0.5)[1]
    assert abs(wrong[3] - PRINTED_B[3]) > 0.5


@pytest.mark.parametrize("name", plants.LIBRARY)
def test_library_plants_against_a_fine_euler_integration(name):
    """Zero-order hold against the definition dx/dt = Ac x + Bc u, by small explicit steps."""
    Ac, Bc = plants.build(name, {})
    period, pieces = 0.2, 200_000
    A, B = gains.discretize(Ac, Bc, period)
    small = np.eye(len(Bc)) + Ac * (period / pieces)
    power = np.linalg.matrix_power(small, pieces)
    np.testing.assert_allclose(A, power, atol=1e-4)
    # Of the constant input, by the same steps on the state and a constant beside it.
    both = np.zeros((len(Bc) + 1, len(Bc) + 1))
    both[:-1, :-1], both[:-1, -1] = Ac, Bc
    stepped = np.linalg.matrix_power(np.eye(len(both)) + both * (period / pieces), pieces)
    np.testing.assert_allclose(B, stepped[:-1, -1], atol=1e-4)
    assert gains.controllability(A, B).rank == len(Bc)


def matrices_of_the_paper(system, graph):
    """Q of the union and W of one graph, a row or column for each link (i hears j)."""
    links = sorted((receiver, sender) for sender, receiver in system.links)
    linked = {frozenset(edge) for edge in system.graphs[graph]}
    Q = np.zeros((len(links), system.agents))
    W = np.zeros((system.agents, len(links)))
    for place, (receiver, sender) in enumerate(links):
        Q[place, sender - 1] = 1
        W[receiver - 1, place] = frozenset((receiver, sender)) in linked
    return Q, W


LOPSIDED = (
    "{graphs: [{edges: [[1, 2], [1, 3], [4, 5]]}, {edges: [[3, 4], [5, 1], [2, 4]]}], "
    "transition: [[0.9, 0.1], [0.3, 0.7]]}"
)


@pytest.mark.parametrize("name", ["aircraft-fixed", "aircraft-markov", "two-agents", "lopsided"])
def test_norms_against_the_matrices_written_out(name, tmp_path):
    if name == "lopsided":
        request = request_of(tmp_path, LOPSIDED, 5)
        choose.choose(request, "theorem", None)
        system = request.system
        figures = conditions.compute(system, request.controllability)
    else:
        system, figures = computed(SCENARIOS / f"{name}.yaml")
    J = np.eye(system.agents) - 1 / system.agents
    norms = {"G": [], "QW": [], "QL": []}
    averaged = np.zeros((system.agents, system.agents))
    for graph, weight in enumerate(figures.network.pi):
        Q, W = matrices_of_the_paper(system, graph)
        L = np.diag(W.sum(axis=1)) - W @ Q
        averaged += weight * L
        T = np.linalg.eigh(L)[1]
        norms["G"].append(np.linalg.norm(J @ W, 2) ** 2)
        norms["QW"].append(np.linalg.norm(Q @ W, 2) ** 2)
        norms["QL"].append(np.linalg.norm(Q @ L @ T, 2) ** 2)
    net = figures.network
    assert net.lambda_2 == pytest.approx(np.linalg.eigvalsh(averaged)[1])
    assert net.lambda_G == pytest.approx(max(norms["G"]))
    assert net.lambda_QW == pytest.approx(max(norms["QW"]))
    assert net.lambda_QL == pytest.approx(max(norms["QL"]))


FAMILIES = {
    "ring: 7": networkx.cycle_graph(7),
    "complete: 5": networkx.complete_graph(5),
    "star: 9": networkx.star_graph(8),
    "path: 6": networkx.path_graph(6),
    "grid: [4, 5]": networkx.grid_2d_graph(4, 5),
    "random_regular: {n: 12, degree: 4, seed: 1}": networkx.random_regular_graph(4, 12, seed=1),
}

WHOLE = """\
name: family
plant: integrator
gains: {{roots: [], beta: auto, gamma: auto, t0: auto}}
quantizer: {{threshold: auto, bound: auto}}
noise: {{sigma: 1}}
topology: {topology}
initial: {{states: {states}, estimates: 0}}
channel: {{mode: link}}
bus: {{model: ideal, bitrate: 500000, encoding: payload}}
period: 1
steps: 10
"""


def request_of(folder: Path, topology: str, agents: int):
    states = [[0.5 - k / agents] for k in range(agents)]
    path = folder / "system.yaml"
    path.write_text(WHOLE.format(topology=topology, states=states))
    return reader.read(path)


@pytest.mark.parametrize("family", FAMILIES)
def test_lambda_2_of_families_agrees_with_networkx(family, tmp_path):
    """One graph: the Laplacian's second eigenvalue is the algebraic connectivity."""
    graph = FAMILIES[family]
    request = request_of(tmp_path, f"{{{family}}}", len(graph))
    assert networkx.is_isomorphic(networkx.Graph(request.system.graphs[0]), graph)
    expected = networkx.algebraic_connectivity(graph, method="lanczos", seed=1)
    figures = conditions.network_figures(request.system)
    assert figures.lambda_2 == pytest.approx(expected, rel=1e-6)


def test_lambda_2_of_a_chain_agrees_with_networkx(tmp_path):
    """A chain: that of the union with each edge weighted by how often it is there. The law is that
    of a long power of the transition matrix."""
    topology = (
        "{graphs: [{edges: [[1, 2], [3, 4]]}, {path: 4}, {edges: [[4, 1]]}], "
        "transition: [[0.1, 0.6, 0.3], [0.5, 0.2, 0.3], [0.25, 0.25, 0.5]]}"
    )
    system = request_of(tmp_path, topology, 4).system
    law = np.linalg.matrix_power(system.transition, 200)[0]
    union = networkx.Graph()
    for weight, graph in zip(law, system.graphs, strict=True):
        for a, b in graph:
            before = union.get_edge_data(a, b, {"weight": 0})["weight"]
            union.add_edge(a, b, weight=before + weight)
    figures = conditions.network_figures(system)
    np.testing.assert_allclose(figures.pi, law, rtol=1e-12)
    expected = networkx.algebraic_connectivity(union, weight="weight", method="lanczos", seed=1)
    assert figures.lambda_2 == pytest.approx(expected, rel=1e-6)


def test_edge_list_file(tmp_path):
    (tmp_path / "four.edges").write_text("# two agents a line\n1 2\n\n3 2 # the middle\n4 3\n")
    system = request_of(tmp_path, "{edge_list: four.edges}", 4).system
    assert system.graphs == [[(1, 2), (3, 2), (4, 3)]]
    assert system.links == [(1, 2), (2, 1), (2, 3), (3, 2), (3, 4), (4, 3)]


def test_automatic_numbers_meet_their_conditions_by_the_stated_margin(tmp_path):
    request = request_of(tmp_path, "{ring: 7}", 7)
    choices = choose.choose(request, "theorem", None)
    reader.check_numbers(request)
    system, sigma = request.system, request.system.sigma
    figures = conditions.compute(system, request.controllability)
    assert {choice.name for choice in choices} == set(reader.AUTOMATIC)
    assert all(condition.holds for condition in figures.conditions)
    assert system.gamma >= choose.GAMMA_MARGIN / figures.network.lambda_2
    assert 1 <= system.beta / (choose.BETA_MARGIN * figures.beta_rate) < 1.02
    largest = np.abs(system.initial_states @ system.K2).max()
    assert 1 <= system.bound / (choose.BOUND_MARGIN * largest) < 1.02
    assert system.t0 - 1 <= figures.t0_min < system.t0
    # No other gamma on a fine grid asks less of beta, beside the rounding to three digits.
    net = figures.network
    grid = np.linspace(choose.GAMMA_MARGIN, 4, 4000) / net.lambda_2
    least = min(conditions.beta_rate(net, gamma, figures.f_M) for gamma in grid)
    assert figures.beta_rate <= least * 1.001
    # No other threshold carries more at its worst.
    values = np.linspace(-system.bound, system.bound, 201)

    def worst(threshold):
        return choose.fisher_information(threshold, values, sigma).min()

    assert all(worst(c) <= worst(system.threshold) for c in np.linspace(-2, 2, 81))


def test_fisher_information_is_that_of_a_bit():
    """f^2/(F(1-F)) against the expected square of the derivative of the log-likelihood."""
    c, z, sigma, h = 0.7, 0.2, 1.5, 1e-5

    def probability(value):
        return 0.5 * math.erfc((value - c) / sigma / math.sqrt(2))

    p, slope = probability(z), (probability(z + h) - probability(z - h)) / (2 * h)
    expected = p * (slope / p) ** 2 + (1 - p) * (slope / (1 - p)) ** 2
    assert choose.fisher_information(c, z, sigma) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("states", [2, 3])
def test_horizon_is_the_derivative_of_the_eigenvalue(states):
    """Every sensitivity against the eigenvalue of a plant whose entry has moved."""
    generator = np.random.default_rng(states)
    A = generator.normal(size=(states, states))
    B = generator.normal(size=states)
    K1, K2 = gains.rows(A, B, [0.3, -0.2][: states - 1])
    system, _ = computed(SCENARIOS / "two-agents.yaml")
    system.A, system.B, system.K1, system.K2 = A, B, K1, K2
    horizon = conditions.horizon(system, 2.0)

    def eigenvalue(A, B):
        values = np.linalg.eigvals(A + np.outer(B, K1))
        return values[np.argmin(np.abs(values - 1))].real

    h = 1e-6
    total = 0.0
    for row in range(states):
        for column in range(states):
            moved = A.copy()
            moved[row, column] += h
            slope = (eigenvalue(moved, B) - 1) / h
            assert horizon.A[row, column] == pytest.approx(slope, rel=1e-3, abs=1e-5)
            total += abs(slope * A[row, column]) * 1e-3
        moved = B.copy()
        moved[row] += h
        slope = (eigenvalue(A, moved) - 1) / h
        assert horizon.B[row] == pytest.approx(slope, rel=1e-3, abs=1e-5)
        total += abs(slope * B[row]) * 1e-3
    assert horizon.eigenvalue_error == pytest.approx(total, rel=1e-3)
    assert horizon.t == pytest.approx(system.gamma * 2.0 / total, rel=1e-3)


def test_the_scenarios_of_the_simulator_are_systems():
    for path in SCENARIOS.glob("*.yaml"):
        system, _ = computed(path)
        assert system.name == yaml.safe_load(path.read_text())["name"]


def test_stationary_law_of_a_lopsided_chain():
    transition = np.array([[0.999, 0.001, 0], [0, 0.5, 0.5], [0.25, 0, 0.75]])
    law = network.stationary(transition)
    np.testing.assert_allclose(law @ transition, law, rtol=1e-12)
    assert law.sum() == pytest.approx(1)
