"""Properties of the gains over random controllable plants, of formats and of written numbers."""

import sys

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from simulator import ROOT

sys.path.insert(0, str(ROOT / "tools"))

from onebit_design import choose, gains, header, reader

ROUNDING = gains.ROUNDING
# Of the constants in LAPACK's error bounds, for n up to 6.
MARGIN = 500


def entries(count):
    return st.lists(st.floats(-2, 2, allow_subnormal=False), min_size=count, max_size=count)


@st.composite
def plants(draw):
    """A plant of up to six states, and roots for it: apart from each other, so that eigenvalues
    are well defined, some in conjugate pairs."""
    n = draw(st.integers(1, 6))
    A = np.array(draw(entries(n * n))).reshape(n, n)
    B = np.array(draw(entries(n)))
    roots = []
    while len(roots) < n - 1:
        if n - 1 - len(roots) >= 2 and draw(st.booleans()):
            root = complex(draw(st.floats(-0.6, 0.6)), draw(st.floats(0.1, 0.6)))
            roots += [root, root.conjugate()]
        else:
            roots.append(complex(draw(st.floats(-0.9, 0.9))))
    return A, B, roots


def relative(value, size):
    return np.abs(value).max() / np.abs(size).max()


@settings(max_examples=300, deadline=None, derandomize=True)
@given(plants())
def test_gains_of_random_plants(plant):
    A, B, roots = plant
    n = len(B)
    controllability = gains.controllability(A, B)
    assume(controllability.rank == n and controllability.condition < gains.CONDITION_LIMIT)
    K1, K2 = gains.rows(A, B, roots)
    closed = A + np.outer(B, K1)
    # What rounding of a product's terms alone may leave.
    size = np.abs(K2) @ (np.abs(A) + np.outer(np.abs(B), np.abs(K1))) + np.abs(K2)
    assert np.abs(K2 @ closed - K2).max() <= MARGIN * ROUNDING * size.max()
    assert abs(K2 @ B - 1) <= MARGIN * ROUNDING * (np.abs(K2) @ np.abs(B))

    # The paper's K1~ P is the same row: a the last row of P A P^-1, b the roots' coefficients.
    P = gains.brunovsky(A, B)
    canonical = P @ A @ np.linalg.inv(P)
    b = np.concatenate([np.real(np.poly(roots))[::-1] if roots else [1.0]])
    a = canonical[-1]
    row = np.array([-a[k] + b[k] - (b[k - 1] if k > 0 else 0) for k in range(n)])
    tolerance = MARGIN * ROUNDING * controllability.condition * np.linalg.cond(P)
    assume(tolerance < 1e-3)
    assert relative(row @ P - K1, np.concatenate([K1, K2])) <= tolerance
    # Brunovsky's form.
    last = np.zeros(n)
    last[-1] = 1
    assert np.abs(P @ B - last).max() <= tolerance
    if n > 1:
        assert relative(canonical[:-1] - np.eye(n)[1:], canonical) <= tolerance

    # Eigenvalues: each as far off as its own condition lets an error of that size move it.
    values, left, right = eigen(closed)
    wanted = np.array([1, *roots])
    error = tolerance * np.abs(closed).max()
    for k, value in enumerate(values):
        sensitivity = 1 / abs(left[:, k].conj() @ right[:, k])
        assume(sensitivity * error < 1e-3)
        assert np.abs(wanted - value).min() <= MARGIN * sensitivity * error
    if len(roots) == len(set(roots)):
        for root in wanted:
            assert np.abs(values - root).min() < 0.05


def eigen(matrix):
    from scipy.linalg import eig

    return eig(matrix, left=True, right=True)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(plants(), st.integers(0, 5))
def test_rank_of_a_plant_with_a_motion_out_of_reach(plant, hidden):
    """A state that the input moves neither directly nor through others, in any coordinates."""
    A, B, _ = plant
    n = len(B)
    hidden %= n
    assume(n > 1)
    A[hidden, :] = 0
    A[hidden, hidden] = 0.5
    B[hidden] = 0
    turn, _ = np.linalg.qr(np.arange(1, n * n + 1).reshape(n, n) ** 1.5 + np.eye(n))
    assert gains.controllability(turn @ A @ turn.T, turn @ B).rank < n


@given(st.floats(1e-12, 1e12))
def test_rounded_up_is_a_little_above(value):
    rounded = choose.rounded_up(value)
    assert value <= rounded <= value * 1.0101
    assert len(f"{rounded:.10e}".split("e")[0].rstrip("0").replace(".", "")) <= 3


@given(st.floats(2.0**-31, reader.CONTROL_GAIN_MAX))
def test_coefficient_holds_the_value(value):
    """As lib/onebit_types.h has it: 32 bits of which the first is set."""
    number, integer, bits = header.coefficient(value)
    assert number == value
    assert integer.endswith("u")
    assert 2**31 <= int(integer[:-1]) < 2**32 and 0 <= bits <= 62
    assert abs(int(integer[:-1]) * 2.0**-bits - value) <= value * 2.0**-32


@given(st.floats(-16, 16), st.integers(0, 46))
def test_fixed_rounds_to_the_nearest_and_saturates(value, bits):
    integer = header.fixed(value, bits)
    assert -(2**31) <= integer <= 2**31 - 1
    scaled = value * 2.0**bits
    if -(2.0**31) < scaled < 2.0**31 - 1:
        assert abs(integer - scaled) <= 0.5
