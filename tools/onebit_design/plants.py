"""Plants by name: continuous-time models dx/dt = Ac x + Bc u with named physical parameters.

Every entry is a function whose parameters, in SI units, are those that an input file may set; the
first line of its documentation names its states and input.
"""

import inspect

import numpy as np


def integrator(rate=1.0):
    """State: level (or pressure, phase); input: flow."""
    return [[0]], [rate]


def double_integrator(mass=1.0):
    """States: position, velocity; input: force."""
    return [[0, 1], [0, 0]], [0, 1 / mass]


def aircraft(
    inertia=1.0,
    mass=1.0,
    friction=4.0,
    elevator_lift=1.0,
    wing_lift=5.0,
    elevator_arm=3.0,
    wing_arm=0.2,
):
    """States: angle of attack, its rate, altitude, climb rate; input: the elevator's angle.

    The paper's equation (dynamics). It prints B_c with a last entry 1; its own second line and its
    printed B_d need -C_ZE/m. Its equation has the lift's torque on the angle's rate,
    its printed A_c on the angle; the printed numbers are followed.
    """
    torque = (elevator_lift * elevator_arm + wing_lift * wing_arm) / inertia
    return (
        [
            [0, 1, 0, 0],
            [-torque, -friction / inertia, 0, 0],
            [0, 0, 0, 1],
            [(elevator_lift + wing_lift) / mass, 0, 0, 0],
        ],
        [0, elevator_lift * elevator_arm / inertia, 0, -elevator_lift / mass],
    )


def dc_motor(inertia=0.01, friction=0.1, torque_constant=0.01, resistance=1.0, inductance=0.5):
    """States: angle, speed, armature current; input: voltage."""
    return (
        [
            [0, 1, 0],
            [0, -friction / inertia, torque_constant / inertia],
            [0, -torque_constant / inductance, -resistance / inductance],
        ],
        [0, 0, 1 / inductance],
    )


def two_mass_oscillator(first_mass=1.0, second_mass=1.0, stiffness=1.0, damping=0.1):
    """States: position and velocity of the first mass, then of the second, which a spring and a
    damper join to it; input: force on the first."""
    k, d = stiffness, damping
    return (
        [
            [0, 1, 0, 0],
            [-k / first_mass, -d / first_mass, k / first_mass, d / first_mass],
            [0, 0, 0, 1],
            [k / second_mass, d / second_mass, -k / second_mass, -d / second_mass],
        ],
        [0, 1 / first_mass, 0, 0],
    )


LIBRARY = {
    "integrator": integrator,
    "double-integrator": double_integrator,
    "aircraft": aircraft,
    "dc-motor": dc_motor,
    "two-mass-oscillator": two_mass_oscillator,
}


def parameters(name: str) -> list[str]:
    return list(inspect.signature(LIBRARY[name]).parameters)


def build(name: str, values: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Ac and Bc of a library plant with these parameters, the others as they are by default."""
    dynamics, control = LIBRARY[name](**values)
    return np.array(dynamics, dtype=float), np.array(control, dtype=float)
