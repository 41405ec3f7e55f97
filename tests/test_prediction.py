"""The predicted disagreement lies within the confidence band of simulated ensembles.

The band of a row is its mean plus and minus a quantile of Student's t times its standard error.
Over all rows and scenarios together (Bonferroni) a true prediction leaves it with a probability of
at most FAMILY_LEVEL; the seed is fixed, so the outcome is too.
"""

import dataclasses
import sys
import xml.etree.ElementTree as ElementTree
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import yaml
from scipy.stats import norm
from scipy.stats import t as student
from simulator import ROOT, SCENARIOS, rows, run

sys.path.insert(0, str(ROOT / "tools"))

from onebit_design import prediction
from onebit_design.system import System

FAMILY_LEVEL = 0.01
# Scenario, runs, steps. Enough runs that the band is 6 to 25 % wide on either side; enough steps
# for nearly half a decade or more after the prediction begins to hold.
ENSEMBLES = (
    ("two-agents", 6000, 1000),
    ("aircraft-fixed", 150, 20000),
    ("aircraft-fixed-broadcast", 300, 20000),
    ("aircraft-markov", 100, 80000),
    ("aircraft-markov-broadcast", 100, 80000),
)
NAMES = [name for name, _, _ in ENSEMBLES]


@cache
def load(name):
    scenario = yaml.safe_load((SCENARIOS / f"{name}.yaml").read_text())
    gains, topology = scenario["gains"], scenario["topology"]
    return System(
        name=scenario["name"],
        A=np.array(scenario["plant"]["A"], dtype=float),
        B=np.array(scenario["plant"]["B"], dtype=float),
        K1=np.array(gains["stabilizing"], dtype=float),
        K2=np.array(gains["compression"], dtype=float),
        beta=gains["beta"],
        gamma=gains["gamma"],
        t0=gains["t0"],
        threshold=scenario["quantizer"]["threshold"],
        bound=scenario["quantizer"]["bound"],
        sigma=scenario["noise"]["sigma"],
        graphs=[[tuple(edge) for edge in graph["edges"]] for graph in topology["graphs"]],
        transition=np.array(topology.get("transition", [[1]]), dtype=float),
        initial_states=np.array(scenario["initial"]["states"], dtype=float),
        initial_estimate=scenario["initial"]["estimates"],
        mode=scenario["channel"]["mode"],
        bus=scenario["bus"],
        period=scenario["period"],
        steps=scenario["steps"],
    )


@cache
def predicted(name):
    steps = next(steps for other, _, steps in ENSEMBLES if other == name)
    return prediction.predict(load(name), steps)


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory):
    @cache
    def simulate(name):
        runs, steps = next(sizes for other, *sizes in ENSEMBLES if other == name)
        folder = tmp_path_factory.mktemp(name)
        run(SCENARIOS / f"{name}.yaml", runs=runs, steps=steps, seed=2024, out=folder)
        return rows(folder / "mse.csv")

    return simulate


def column(table, name):
    return np.array([float(row[name]) for row in table])


def holds(name):
    """Which rows the prediction is for."""
    return np.array(predicted(name).row_steps) >= predicted(name).valid_from


def distance(name, table):
    """Of the rows where the prediction holds: how far off it is, in half widths of the band."""
    compared = sum(np.count_nonzero(holds(other)) for other in NAMES)
    runs = next(runs for other, runs, _ in ENSEMBLES if other == name)
    half_width = student.ppf(1 - FAMILY_LEVEL / (2 * compared), runs - 1)
    error = predicted(name).mse - column(table, "mse")
    return (error[holds(name)]) / (half_width * column(table, "mse_se")[holds(name)])


@pytest.mark.parametrize("name", NAMES)
def test_prediction_lies_within_the_band(name, ensemble):
    table = ensemble(name)
    assert [int(row["step"]) for row in table] == predicted(name).row_steps
    np.testing.assert_array_equal(column(table, "t"), predicted(name).t)
    assert np.count_nonzero(holds(name)) >= 9
    assert np.max(np.abs(distance(name, table))) < 1


@pytest.mark.parametrize("name", NAMES)
def test_band_is_narrow_enough_to_refuse_a_wrong_prediction(name, ensemble):
    # A prediction a third too high or too low would leave the band.
    table = ensemble(name)
    centre = column(table, "mse")[holds(name)]
    half_width = (predicted(name).mse[holds(name)] - centre) / distance(name, table)
    assert np.all(half_width < centre / 3)


@pytest.mark.parametrize("name", NAMES)
def test_estimation_error_agrees(name, ensemble):
    # mse.csv has no standard error of it; links and rows are many, so their mean is sharp.
    ratio = predicted(name).estimate_mse / column(ensemble(name), "estimate_mse")
    assert abs(np.mean(ratio[holds(name)]) - 1) < 0.05


@pytest.mark.parametrize("name", ["two-agents", "aircraft-fixed", "aircraft-fixed-broadcast"])
def test_bounded_phase_is_followed(name, ensemble):
    # Before it is said to hold, the prediction still is near: what it remembers of that is right.
    ratio = predicted(name).mse / column(ensemble(name), "mse")
    early = ~holds(name) & (np.array(predicted(name).row_steps) > 0)
    assert np.max(np.abs(ratio[early] - 1)) < 0.25
    assert abs(np.mean(ratio[early]) - 1) < 0.05


def scalar_pair(**changes):
    """Two agents with the plant x' = x + u, no stabilizing needed, one link each way."""
    system = dataclasses.replace(
        load("two-agents"),
        A=np.array([[1.0]]),
        B=np.array([1.0]),
        K1=np.array([0.0]),
        K2=np.array([1.0]),
        initial_states=np.array([[-0.25], [0.25]]),
    )
    return dataclasses.replace(system, **changes)


def test_pair_has_the_closed_form():
    # With d = z_1 - z_2 and g the difference of what they believe, estimate of 1 less that of 2,
    # which tracks -d: in s = log t, d' = -gamma (d - g), g' = k (-d - g) + noise. Written for
    # (d, g) with drift H the equation (H + I/2) X + X (H + I/2)' + Q = 0 solves by hand. The agents
    # are at +-d/2. Small variations of the agreed value, so that f and F are those of z = 0.
    system = scalar_pair(sigma=50.0, beta=2400.0, bound=100.0)
    gamma, slope = system.gamma, norm.pdf(0) / system.sigma
    rate, intensity = system.beta * slope, system.beta**2 / 4 * 2
    (a, b), (c, d) = (0.5 - gamma, gamma), (-rate, 0.5 - rate)
    # From 2 a X11 + 2 b X12 = 0, c X11 + (a + d) X12 + b X22 = 0, 2 c X12 + 2 d X22 + Q = 0.
    x12_of_x11 = -a / b
    x22_of_x11 = -(c + (a + d) * x12_of_x11) / b
    x11 = -intensity / (2 * c * x12_of_x11 + 2 * d * x22_of_x11)
    # The agreed value does vary by some; average F(1-F)/f and F(1-F)/f^2 differ in the 4th digit.
    made = prediction.predict(system, 10**7)
    scale = (made.agreed_deviation / system.sigma) ** 2
    assert made.limit == pytest.approx(x11 / 4, rel=2 * scale + 1e-6)


@pytest.mark.parametrize("name", ["two-agents", "aircraft-fixed", "aircraft-markov-broadcast"])
def test_recursion_reaches_the_limit(name):
    made = prediction.predict(load(name), 10**7)
    assert made.t[-1] * made.mse[-1] == pytest.approx(made.limit, rel=1e-3)
    # The estimates' fast noise is that of the middle of the last block of steps: half a percent.
    assert made.t[-1] * made.estimate_mse[-1] == pytest.approx(made.estimate_limit, rel=6e-3)


def test_rate_needs_gamma():
    # gamma lambda_2 = 0.4: below 1/2 the slowest mode falls more slowly than the noise.
    slow = prediction.predict(dataclasses.replace(load("two-agents"), gamma=0.2), 1000)
    assert slow.limit == np.inf
    assert slow.slowest_rate < 0.5
    assert any("rate 1/t is not reached" in line for line in prediction.report_lines(slow))


@pytest.mark.parametrize("step", [1e-3, 1e3])
def test_estimator_law_has_its_limits(step):
    threshold, bound, value = -0.5, 0.6, 0.1
    probability = norm.cdf(threshold - value)
    law = prediction.EstimatorLaw(threshold, bound)
    mean, slope, variance, total = (figure.item() for figure in law(step, np.array([value])))
    if step < 1:  # the linearised estimator
        density = norm.pdf(threshold - value)
        spread = probability * (1 - probability)
        expected = step * spread / (2 * density), spread / density**2
        assert (mean, slope) == pytest.approx((value, 1), abs=2e-3)
    else:  # each bit throws the estimate from bound to bound
        both = 4 * bound**2 * probability * (1 - probability)
        expected = both, both
        assert mean == pytest.approx(bound * (1 - 2 * probability), rel=1e-3)
        assert slope == pytest.approx(2 * bound * norm.pdf(threshold - value), rel=2e-2)
    assert (variance, total) == pytest.approx(expected, rel=2e-2)


def test_estimator_law_is_that_of_its_equation():
    # In between, against the projected recursion itself with a constant step.
    step, value, threshold, bound, count = 0.4, 0.3, -0.5, 0.6, 4000
    random = np.random.default_rng(5)
    estimate, history = np.zeros(count), []
    for _ in range(400):
        bit = random.random(count) < norm.cdf(threshold - value)
        moved = estimate + step * (norm.cdf(threshold - estimate) - bit)
        estimate = np.clip(moved, -bound, bound)
        history.append(estimate)
    history = np.array(history[50:])
    mean, variance, total = prediction.estimator_law(step, value, threshold, bound)
    assert np.mean(history) == pytest.approx(mean, abs=0.002)
    assert np.var(history) == pytest.approx(variance, rel=0.01)
    # The variance of a long sum is its length times the sum of all autocovariances.
    assert np.var(history.sum(axis=0)) / len(history) == pytest.approx(total, rel=0.1)


def test_cramer_rao_ratio():
    system, value = load("two-agents"), 0.2
    u = (system.threshold - value) / system.sigma
    slope, spread = norm.pdf(u) / system.sigma, norm.cdf(u) * norm.sf(u)
    best = dataclasses.replace(system, beta=1 / slope)
    for link in prediction.link_information(best, value):
        assert link.ratio == pytest.approx(1)
        assert link.best_beta == pytest.approx(1 / slope)
        assert link.information == pytest.approx(slope**2 / spread)
        assert link.bound == pytest.approx(1 / link.information)
    for factor in (0.7, 1.5, 20):
        (link, _) = prediction.link_information(
            dataclasses.replace(best, beta=factor / slope), value
        )
        assert link.ratio > 1
        assert link.variance == pytest.approx(  # a published limit
            (factor / slope) ** 2 * spread / (2 * factor - 1)
        )
    # Half of 1/f or less: the start is forgotten more slowly than the bits would allow.
    slow = dataclasses.replace(best, beta=0.5 / slope)
    assert prediction.link_information(slow, value)[0].ratio == np.inf


def test_cramer_rao_counts_the_bits_of_a_switched_link():
    links = prediction.link_information(load("aircraft-markov"), 0.6)
    assert [(link.sender, link.receiver) for link in links] == load("aircraft-markov").links
    assert [link.share for link in links] == pytest.approx([1 / 3] * 20)
    best = dataclasses.replace(load("aircraft-markov"), beta=links[0].best_beta)
    assert prediction.link_information(best, 0.6)[0].ratio == pytest.approx(1)


def test_a_slow_chain_holds_later():
    # The same shares, ten times as long in each graph.
    system = load("aircraft-markov")
    slow = dataclasses.replace(system, transition=0.9 * np.eye(3) + 0.1 * system.transition)
    usual, late = predicted("aircraft-markov"), prediction.predict(slow, 1000)
    assert late.chain_mixed > 8 * usual.chain_mixed
    assert late.valid_from is None
    np.testing.assert_allclose(late.mse, usual.mse[: len(late.mse)], rtol=1e-9)


def test_start_is_that_of_the_scenario():
    made = prediction.predict(load("aircraft-fixed"), 0)
    states = load("aircraft-fixed").initial_states
    assert made.row_steps == [0]
    assert made.mse[0] == pytest.approx(np.mean(np.sum((states - states.mean(0)) ** 2, axis=1)))


def test_stable_modes_are_kept_while_they_count():
    # Unequal climb rates: at first the disagreement is of the stable modes, which the filter damps.
    # Without noise in the bits' direction the linear filter alone says what comes of them.
    system = load("aircraft-fixed")
    states = system.initial_states.copy()
    states[:, 0] = 1000 * np.array([1, -1, 2, -2, 0, 3, -3])
    states[:, 2] -= (states @ system.K2 - system.initial_states @ system.K2) / system.K2[2]
    made = prediction.predict(dataclasses.replace(system, initial_states=states), 10)
    closed = system.A + np.outer(system.B, system.K1)
    for row, mse in zip(made.row_steps, made.mse, strict=True):
        free = states @ np.linalg.matrix_power(closed, row).T
        assert mse == pytest.approx(np.mean(np.sum((free - free.mean(0)) ** 2, axis=1)), rel=1e-2)


@pytest.mark.parametrize("steps", [1, 9, 10, 1000, 12345])
def test_rows(steps):
    made = prediction.recorded_steps(steps)
    assert made[0] == 0 and made[1] == 1 and made[-1] == steps
    assert all(before < after for before, after in pairwise(made))


def test_picture_is_deterministic(tmp_path):
    made = predicted("two-agents")
    table = [
        {"step": str(step), "t": str(t), "mse": str(mse), "mse_se": str(mse / 10)}
        for step, t, mse in zip(made.row_steps, made.t, made.mse, strict=True)
    ]
    pictures = [tmp_path / "one.svg", tmp_path / "two.svg"]
    for picture in pictures:
        prediction.draw(made, table, picture)
    assert pictures[0].read_bytes() == pictures[1].read_bytes()
    text = "".join(ElementTree.parse(pictures[0]).getroot().itertext())
    assert "two-agents" in text and "standard errors" in text
    assert f"holds from step {made.valid_from:,}" in text
    # One run has no band.
    prediction.draw(made, [row | {"mse_se": ""} for row in table], tmp_path / "three.svg")
    assert "standard errors" not in (tmp_path / "three.svg").read_text()


def test_report_names_the_figures():
    made = predicted("aircraft-fixed")
    text = "\n".join(prediction.report_lines(made))
    assert f"{made.limit:.4g}" in text
    assert f"holds from step {made.valid_from:,}" in text
    assert "7>6" in text
    short = prediction.predict(load("aircraft-fixed"), 100)
    assert short.valid_from is None
    assert "does not yet hold" in "\n".join(prediction.report_lines(short))
