"""A system as the scenario file that onebit-sim takes."""

import yaml

from .formats import Formats
from .system import System


def _numbers(values) -> list:
    """Without a fraction where there is none, to all digits elsewhere."""
    return [_number(float(value)) for value in values]


def _number(value: float) -> int | float:
    return int(value) if value.is_integer() and abs(value) < 1e15 else value


def render(system: System, formats: Formats) -> str:
    plant = {"A": [_numbers(row) for row in system.A], "B": _numbers(system.B)}
    if system.integer_plant:
        plant["arithmetic"] = "q31"
    topology = {"graphs": [{"edges": [list(edge) for edge in graph]} for graph in system.graphs]}
    if len(system.graphs) > 1:
        topology["transition"] = [_numbers(row) for row in system.transition]
    content = {
        "name": system.name,
        "plant": plant,
        "gains": {
            "stabilizing": _numbers(system.K1),
            "compression": _numbers(system.K2),
            "beta": _number(float(system.beta)),
            "gamma": _number(float(system.gamma)),
            "t0": system.t0,
        },
        "quantizer": {
            "threshold": _number(float(system.threshold)),
            "bound": _number(float(system.bound)),
        },
        "noise": {"sigma": _number(float(system.sigma))},
        "topology": topology,
        "initial": {
            "states": [_numbers(row) for row in system.initial_states],
            "estimates": _number(float(system.initial_estimate)),
        },
        "channel": {"mode": system.mode},
        "bus": {**system.bus, "bitrate": _number(float(system.bus["bitrate"]))},
        "fixed": {
            "state_fraction_bits": formats.state,
            "control_fraction_bits": formats.control,
        },
        "period": _number(float(system.period)),
        "steps": system.steps,
    }
    return "# Written by onebit-design.\n" + yaml.safe_dump(
        content, sort_keys=False, default_flow_style=None, width=10**6, allow_unicode=True
    )
