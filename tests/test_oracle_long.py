"""Fed the same states and bits, every arithmetic of the library against the oracle (label: long).

The oracle runs closed loop with noise of its own; `oracle-feed-<arithmetic>` gives the same states
and bits to the library's agents and writes what they estimate and command. Formats, little endian:

    input   one record a step: x_i(t), agent after agent, as float64; then one byte for each
            directed link of the union, sorted by sender and receiver: the bit, or 255 where none
            was heard
    output  one record a step: zhat_ij(t) of the same links in the paper's units, then u_i(t), all
            float64
"""

import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import oracle
import pytest
import yaml
from scipy.special import ndtr

ROOT = Path(__file__).resolve().parent.parent
BUILD = Path(os.environ.get("ONEBIT_BUILD", ROOT / "build/host")).resolve()
STEPS = int(os.environ.get("ONEBIT_ORACLE_STEPS", "1000000"))
SEEDS = {"aircraft-fixed": 20240601, "aircraft-markov": 20240602}
NOT_HEARD = 255
CHUNK = 50_000  # steps compared at once, to bound memory

# Where a scenario leaves its fixed-point formats to the program, this test states them: the
# tolerance on u has to know the quantum. 26 fraction bits leave +-32 for states that stay below 6
# (K2 x within +-M through the filter 1/(s - 1/2)^3) and for controls below 2.
FORMATS = {"state_fraction_bits": 26, "control_fraction_bits": 26}


@dataclass
class Feed:
    path: Path  # of the scenario
    scenario: oracle.Scenario
    input_path: Path
    inputs: np.ndarray
    expected: np.ndarray


@pytest.fixture(scope="module", params=list(SEEDS))
def feed(request, tmp_path_factory):
    """One closed-loop run of the oracle, serving all arithmetics."""
    name = request.param
    folder = tmp_path_factory.mktemp(name)
    tree = yaml.safe_load((ROOT / f"sim/scenarios/{name}.yaml").read_text(encoding="utf-8"))
    tree.setdefault("fixed", FORMATS)
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(tree), encoding="utf-8")
    scenario = oracle.read_scenario(path)
    agents, links = scenario.agents, scenario.links
    input_record = [("states", "<f8", scenario.states.shape), ("bits", "u1", (links,))]
    output_record = [("estimates", "<f8", (links,)), ("controls", "<f8", (agents,))]
    inputs = np.memmap(folder / "input", input_record, "w+", shape=STEPS)
    expected = np.memmap(folder / "expected", output_record, "w+", shape=STEPS)
    states, bits = inputs["states"], inputs["bits"]
    estimates, controls = expected["estimates"], expected["controls"]
    noise = oracle.GaussianNoise(scenario, SEEDS[name])
    for row, step in enumerate(oracle.simulate(scenario, noise, STEPS)):
        states[row] = step.states
        bits[row] = np.where(step.heard, step.bits, NOT_HEARD)
        estimates[row] = step.estimates
        controls[row] = step.controls
    inputs.flush()
    yield Feed(path, scenario, folder / "input", inputs, expected)
    shutil.rmtree(folder)


def single_precision_bounds(feed):
    """Bounds on |error of w| for f32, w = zhat/sigma: at any step, and once t > 100 b.

    In exact numbers w(t) = clamp(w(t-1) + g (F(v) - s)), with g = b/t and v = c/sigma - w(t-1). Let
    r = 2^-24. The library's value (its remainder carried, so that the rounding of the sum does not
    pile up) follows the same recursion with two local errors: `distribution` on F, the 4.2e-7 of
    lib/onebit_cdf.h and 4 r for the rounding of its argument and result; and `increment`, 4 r
    relative, for the roundings of b, of b/t, of F - s and of the product. Hence before clamping

        e(t) <= max |1 - g f(v)| e(t-1) + g (distribution + increment max |F - s|),

    with f between f_min and f_max over |w| <= M/sigma; and where the exact sum passes a bound by o,
    clamping takes o off the error. While g f_max > 1 the factor can exceed one, and the recursion
    is evaluated along the run itself, whose clamping keeps it small. From then on the factor is at
    most 1 - g f_min, so e(t) <= max(e(t-1), E), E = (distribution + increment max |F - s|) / f_min;
    and between t = b f_max and 100 b what came before E shrinks by (f_max/100)^(b f_min), to
    nothing. What is reported lacks the remainder and is rounded: r times M/sigma more.
    """
    scenario, rounding = feed.scenario, 2.0**-24
    step_size, threshold, bound = (
        value / scenario.sigma for value in (scenario.beta, scenario.threshold, scenario.bound)
    )
    smallest, largest = threshold - bound, threshold + bound
    outer = max(abs(smallest), abs(largest))
    inner = 0.0 if smallest < 0.0 < largest else min(abs(smallest), abs(largest))
    f_min, f_max = np.exp(np.array([-(outer**2), -(inner**2)]) / 2) / np.sqrt(2 * np.pi)
    distribution = 4.2e-7 + 4 * rounding
    local = distribution + 4 * rounding * max(1.0 - ndtr(smallest), ndtr(largest))

    error = np.zeros(scenario.links)
    worst = 0.0
    previous = np.full(scenario.links, scenario.estimates / scenario.sigma)
    for row in range(min(STEPS, int(step_size * f_max))):
        gain = step_size / (scenario.t0 + 1 + row)
        bits = feed.inputs["bits"][row]
        heard = bits != NOT_HEARD
        moved = previous + gain * (ndtr(threshold - previous) - bits)
        passed = np.maximum(np.abs(moved) - bound, 0.0)
        factor = max(abs(1 - gain * f_min), abs(1 - gain * f_max))
        error = np.where(heard, np.maximum(factor * error + gain * local - passed, 0.0), error)
        worst = max(worst, error.max())
        previous = feed.expected["estimates"][row] / scenario.sigma
    late = local / f_min
    return max(worst, late) + rounding * bound, late + rounding * bound


def estimate_tolerances(feed, arithmetic, t):
    """The permitted difference of every zhat at times t, in the paper's units."""
    scenario = feed.scenario
    if arithmetic == "f64":
        # 1e-11 in z or in z/sigma, whichever is the stricter.
        return np.full(len(t), 1e-11 * min(1.0, scenario.sigma))
    # What the project promises of q31.
    early, late = single_precision_bounds(feed) if arithmetic == "f32" else (5e-5, 1e-5)
    return scenario.sigma * np.where(t > 100 * scenario.beta / scenario.sigma, late, early)


def control_tolerances(scenario, arithmetic, t, inputs, expected, estimate_tolerance):
    """The permitted difference of every u_i(t), from that of the estimates.

    (control) is linear in zhat: an estimate off by e moves u by e gamma/(t+1), and so does each
    neighbour heard. To this comes what computing u costs:

    f64, f32: no term passes through more than k = n + d_max + 8 roundings: x, K2, 1/sigma, a
    product and n - 1 sums make K2 x; the difference, d_max - 1 sums, gamma sigma, its quotient by
    t+1 and a product make the consensus term; K1 x takes fewer, and one sum joins them. So the
    error is at most k r/(1 - k r) times the sum of the terms' magnitudes, r the arithmetic's unit
    roundoff; twice that for f64, where the oracle rounds as coarsely.

    q31: states are rounded to half a quantum, each row of gains to 2^-31 of the power of two above
    its largest entry (a 32-bit format with one bit to spare), K2 x to half a unit of Q4.27 (units
    of sigma), gamma/(t+1) to 2^-15 relative (promised of b/t, and the gain is kept alike),
    and K1 x, the consensus term and u to half a quantum of the control.
    """
    heard = inputs["bits"] != NOT_HEARD
    sizes = np.abs(inputs["states"])
    gain = scenario.gamma / (t + 1)[:, np.newaxis]
    neighbours = heard @ scenario.incidence
    propagated = gain * neighbours * estimate_tolerance[:, np.newaxis]
    if arithmetic == "q31":
        state_error = 2.0 ** -(scenario.fixed["state_fraction_bits"] + 1)
        control_error = 2.0 ** -(scenario.fixed["control_fraction_bits"] + 1)

        def product_error(row):
            entry_error = 2.0**-31 * 2.0 ** np.ceil(np.log2(np.abs(row).max()))
            row_size = np.abs(row).sum()
            return row_size * state_error + entry_error * (sizes.sum(axis=-1) + state_error)

        compressed_error = scenario.sigma * (product_error(scenario.K2 / scenario.sigma) + 2.0**-28)
        compressed = inputs["states"] @ scenario.K2
        differences = (expected["estimates"] - compressed[:, scenario.receivers]) * heard
        consensus = gain * np.abs(differences @ scenario.incidence)
        return (
            propagated
            + product_error(scenario.K1)
            + gain * neighbours * compressed_error
            + 2.0**-15 * consensus
            + 3 * control_error
        )
    terms = np.abs(expected["estimates"]) + (sizes @ np.abs(scenario.K2))[:, scenario.receivers]
    magnitude = sizes @ np.abs(scenario.K1) + gain * ((terms * heard) @ scenario.incidence)
    largest_degree = (scenario.heard @ scenario.incidence).max()
    roundings = len(scenario.K1) + largest_degree + 8
    roundoff = roundings * (2.0**-24 if arithmetic == "f32" else 2.0**-53)
    factor = 1 if arithmetic == "f32" else 2
    return propagated + factor * roundoff / (1 - roundoff) * magnitude


@pytest.mark.parametrize("arithmetic", ["f64", "f32", "q31"])
def test_feed(feed, arithmetic, tmp_path):
    scenario, output_path = feed.scenario, tmp_path / "output"
    program = BUILD / f"bin/oracle-feed-{arithmetic}"
    subprocess.run([program, feed.path, feed.input_path, output_path], check=True)
    assert output_path.stat().st_size == STEPS * feed.expected.dtype.itemsize
    outputs = np.memmap(output_path, feed.expected.dtype, "r")

    first = scenario.t0 + 1
    late_from = 100 * scenario.beta / scenario.sigma
    t_all = np.arange(first, first + STEPS)
    tolerances = estimate_tolerances(feed, arithmetic, t_all)
    worst = dict.fromkeys(["w", "w late", "u", "of zhat's tolerance", "of u's tolerance"], 0.0)

    def note(name, values):
        # Not max(): NaN has to win, and to fail the test.
        worst[name] = np.maximum(worst[name], values.max(initial=0.0))

    for start in range(0, STEPS, CHUNK):
        part = slice(start, start + CHUNK)
        t, tolerance = t_all[part], tolerances[part]
        inputs, expected, actual = feed.inputs[part], feed.expected[part], outputs[part]
        off = np.abs(actual["estimates"] - expected["estimates"])
        note("w", off / scenario.sigma)
        note("w late", off[t > late_from] / scenario.sigma)
        note("of zhat's tolerance", off / tolerance[:, np.newaxis])
        off = np.abs(actual["controls"] - expected["controls"])
        note("u", off)
        permitted = control_tolerances(scenario, arithmetic, t, inputs, expected, tolerance)
        note("of u's tolerance", off / permitted)
    output_path.unlink()

    figures = ", ".join(f"{name} {value:.3g}" for name, value in worst.items())
    print(f"\n{arithmetic}, {STEPS} steps, worst differences: {figures}")
    assert worst["of zhat's tolerance"] <= 1.0
    assert worst["of u's tolerance"] <= 1.0
