"""Reads a system: the scenario format of onebit-sim, in which the plant may be continuous or named,
the gains may be roots, graphs may be families or files, and numbers may be `auto`."""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import networkx
import numpy as np

from . import document, gains, network, plants
from .bus_cost import IDENTIFIER_LAST, agent_limit
from .document import Place
from .problem import InputError
from .system import System

# The library's limits: lib/onebit_limits.h, lib/onebit_agent.c, lib/onebit_frame.c.
STATES_MAX = 16
NEIGHBOURS_MAX = 32
REACH_MAX = 4.0  # (|c| + M) / sigma: beyond, the noise's distribution function is flat
RATIO_MIN = 1e-6  # of beta, M over sigma, gamma sigma: fixed point holds it
ESTIMATOR_GAIN_MAX = 65536.0  # beta / sigma
CONTROL_GAIN_MAX = 4e9  # gamma sigma: the library's range ends at 2^32
CLOCK_LAST = 2**32 - 1
IDENTIFIER_FIRST = 0x081

# onebit-sim's
GRAPHS_MAX = 1000
COMPRESSED_ROUNDING = 1e-12  # relative, of K2 x against M
ROW_SUM_ROUNDING = 1e-9

REQUIRED = (
    *("name", "plant", "gains", "quantizer", "noise"),
    *("topology", "initial", "channel", "bus", "steps"),
)
AUTOMATIC = ("beta", "gamma", "t0", "threshold", "bound")
ROOT_TEXT = re.compile(r"[0-9.eE+-]+j?")


@dataclass
class Request:
    """What the file asks for. In `system` what is `automatic` is not a number yet, and K1 and K2
    belong to `roots` where those are given."""

    system: System
    automatic: set[str]  # of AUTOMATIC
    roots: list[complex] | None
    places: dict[str, Place]  # of the values, by name, for later refusals
    controllability: gains.Controllability

    def refuse(self, name: str, what: str):
        self.places[name].refuse(what)


def _read_matrix(rows: list[Place], columns: int) -> np.ndarray:
    return np.array([row.row(columns) for row in rows])


def _read_plant(place: Place, period: float | None):
    """A, B, the period, and whether the plant's arithmetic is q31."""
    if not place.is_mapping:
        name = place.choice(*plants.LIBRARY)
        keys = {}
        Ac, Bc = plants.build(name, {})
    else:
        names = place.names
        extra = ("arithmetic", "sample_period")
        if "library" in names:
            keys = place.section(["library"], ["parameters", *extra])
            name = keys["library"].choice(*plants.LIBRARY)
            values = {}
            if "parameters" in keys:
                given = keys["parameters"].section([], plants.parameters(name))
                values = {key: value.positive() for key, value in given.items()}
            Ac, Bc = plants.build(name, values)
        else:
            continuous = bool(names & {"Ac", "Bc", "sample_period"})
            a, b = ("Ac", "Bc") if continuous else ("A", "B")
            keys = place.section([a, b], extra if continuous else extra[:1])
            rows = keys[a].items("rows", 1, STATES_MAX)
            Ac, Bc = _read_matrix(rows, len(rows)), np.array(keys[b].row(len(rows)))
            if not continuous:
                if period is None:
                    place.refuse("a plant in discrete time needs the file's key period too")
                return Ac, Bc, period, _is_integer(keys)
    sample_period = keys["sample_period"].positive() if "sample_period" in keys else period
    if sample_period is None:
        place.refuse("must have a sample_period, or the file a period")
    if period is not None and sample_period != period:
        keys["sample_period"].refuse(
            f"must be the period of the steps, {period:g}, or left out, not {sample_period:g}"
        )
    A, B = gains.discretize(Ac, Bc, sample_period)
    if not (np.isfinite(A).all() and np.isfinite(B).all()):
        place.refuse(
            f"overflows when held for {sample_period:g} s, must be slower or sampled faster"
        )
    return A, B, sample_period, _is_integer(keys)


def _is_integer(keys: dict[str, Place]) -> bool:
    return "arithmetic" in keys and keys["arithmetic"].choice("double", "q31") == "q31"


def _read_roots(place: Place, states: int) -> list[complex]:
    """Inside the unit circle, each complex one with its conjugate."""
    roots = []
    items = place.items("roots", states - 1, states - 1)
    for item in items:
        try:
            root = complex(item.plain if ROOT_TEXT.fullmatch(item.plain) else "none")
        except ValueError:
            item.refuse(f"must be a number such as 0.5 or 0.3+0.2j, not {item.seen}")
        if not abs(root) < 1:
            item.refuse(
                f"has magnitude {abs(root):.6g}, must be inside the unit circle, below 1: "
                "the plants' own motion would not die out"
            )
        roots.append(root)
    for root, item in zip(roots, items, strict=True):
        if root.imag != 0 and roots.count(root) != roots.count(root.conjugate()):
            item.refuse(
                f"{item.plain} has no conjugate, must stand with {_text(root.conjugate())}: "
                "else the gains are complex"
            )
    return roots


def _text(root: complex) -> str:
    return f"{root.real:g}{root.imag:+g}j"


FAMILY_KEYS = ("edges", "edge_list", *network.FAMILIES, "grid", "random_regular")


def _read_graph(place: Place, agents: int) -> list[network.Edge]:
    """One graph: a mapping with one of FAMILY_KEYS."""
    keys = place.section([], FAMILY_KEYS)
    if len(keys) != 1:
        place.refuse(f"must have one key of {', '.join(FAMILY_KEYS)}, not {len(keys)}")
    ((name, value),) = keys.items()
    if name == "edges":
        pairs = [
            tuple(agent.integer(0, CLOCK_LAST) for agent in item.items("agents", 2, 2))
            for item in value.items("edges", 0)
        ]
        return _checked(
            pairs, agents, lambda index, what: value.items("edges", 0)[index].refuse(what)
        )
    if name == "edge_list":
        # A path is meant from where the file that names it stands.
        path = value.path.parent / value.text()
        try:
            numbered = network.edge_list(path)
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "is not text"
            value.refuse(f"{path} cannot be read ({reason}), must be a file of edges")
        except network.EdgeListError as error:
            raise InputError(f"{path}:{error.line}: {value.key}: {error}") from None

        def refuse_line(index, what):
            raise InputError(f"{path}:{numbered[index][1]}: {value.key}: {what}")

        return _checked([edge for edge, _ in numbered], agents, refuse_line)
    if name == "grid":
        rows, columns = (
            side.integer(1, CLOCK_LAST) for side in value.items("sides, rows and columns", 2, 2)
        )
        _check_agents(value, rows * columns, agents)
        return network.grid(rows, columns)
    if name == "random_regular":
        numbers = value.section(["n", "degree", "seed"])
        count = numbers["n"].integer(2, CLOCK_LAST)
        _check_agents(value, count, agents)
        degree = numbers["degree"].integer(1, count - 1)
        if count * degree % 2:
            numbers["degree"].refuse(
                f"{count} agents cannot have {degree} neighbours each, n times degree must be even"
            )
        return network.random_regular(count, degree, numbers["seed"].integer(0, CLOCK_LAST))
    least, _ = network.FAMILIES[name]
    count = value.integer(least, CLOCK_LAST)
    _check_agents(value, count, agents)
    return network.family(name, count)


def _check_agents(place: Place, count: int, agents: int) -> None:
    if count != agents:
        place.refuse(f"has {count} agents, must have {agents}, one for each row of initial.states")


def _checked(pairs, agents: int, refuse) -> list[network.Edge]:
    seen = set()
    for index, (a, b) in enumerate(pairs):
        if not (1 <= a <= agents and 1 <= b <= agents):
            refuse(index, f"[{a}, {b}] must be two of the agents 1 to {agents}")
        if a == b:
            refuse(index, f"[{a}, {b}] must be two different agents")
        edge = (min(a, b), max(a, b))
        if edge in seen:
            refuse(index, f"[{a}, {b}] stands twice in its graph, must stand once")
        seen.add(edge)
    return pairs


def _listed(numbers, most: int = 12) -> str:
    """1, 2, 3 in braces, cut where nobody would read on."""
    text = ", ".join(str(number) for number in numbers[:most])
    return f"{{{text}{', ..' if len(numbers) > most else ''}}}"


def _read_topology(place: Place, agents: int):
    if not place.is_mapping:
        place.refuse(f"must be a mapping with the key graphs or one of {', '.join(FAMILY_KEYS)}")
    transition = np.ones((1, 1))
    if place.names & {"graphs", "transition"}:
        keys = place.section(["graphs"], ["transition"])
        items = keys["graphs"].items("graphs", 1, GRAPHS_MAX)
        graphs = [_read_graph(item, agents) for item in items]
        if "transition" in keys:
            transition = _read_transition(keys["transition"], len(graphs))
        elif len(graphs) > 1:
            place.refuse("transition: missing, must be given where there are several graphs")
    else:
        graphs = [_read_graph(place, agents)]
    parts = network.components(agents, graphs)
    if len(parts) > 1:
        listed = ", ".join(_listed(part) for part in parts[:8])
        place.refuse(
            f"{'the union of the graphs' if len(graphs) > 1 else 'the graph'} falls into "
            f"{len(parts)} parts, which never agree, must be joined by {len(parts) - 1} more "
            f"edges: {listed}{', ..' if len(parts) > 8 else ''}"
        )
    degrees = networkx.Graph(edge for edges in graphs for edge in edges).degree
    for agent, degree in sorted(degrees):
        if degree > NEIGHBOURS_MAX:
            place.refuse(
                f"agent {agent} has {degree} neighbours, must have at most {NEIGHBOURS_MAX}, "
                "the library's limit"
            )
    return graphs, transition


def _read_transition(place: Place, count: int) -> np.ndarray:
    rows = place.items("rows, one a graph", count, count)
    for row in rows:
        items = row.items("numbers", count, count)
        for item in items:
            if not 0 <= item.number() <= 1:
                item.refuse(f"must be a probability from 0 to 1, not {item.seen}")
        total = math.fsum(item.number() for item in items)
        if not abs(total - 1) <= ROW_SUM_ROUNDING:
            row.refuse(f"the row's sum must be 1, not {total:.12g}")
    transition = _read_matrix(rows, count)
    classes = network.communicating_classes(transition)
    if len(classes) > 1:
        place.refuse(
            f"the chain is reducible, must come from each graph to each; it does so only within "
            f"the classes {', '.join(_listed(part) for part in classes)}"
        )
    classes = network.cyclic_classes(transition)
    if len(classes) > 1:
        place.refuse(
            f"the chain has period {len(classes)}, must have 1: let a graph stay with some "
            f"probability; it goes round the classes "
            f"{', '.join(_listed(part) for part in classes)}"
        )
    return transition


def _read_bus(place: Place, mode: str, agents: int) -> dict:
    keys = place.section(["model", "bitrate", "encoding"], ["base"])
    bus = {
        "model": keys["model"].choice("ideal", "can"),
        "bitrate": keys["bitrate"].positive(),
        "encoding": keys["encoding"].choice("payload", "identifier"),
    }
    if "base" in keys:
        base = keys["base"]
        if mode == "link":
            base.refuse("means nothing in link mode, must be left out")
        # The one number that may be hexadecimal, as people write identifiers.
        if not re.fullmatch(r"0x[0-9a-fA-F]{1,4}|(?!0\d)\d{1,5}", base.plain):
            base.refuse(f"must be an 11-bit number such as 0x100, not {base.seen}")
        bus["base"] = int(base.plain, 0)
        # Agent 1 stands above base, so base itself may be SYNC's identifier.
        if bus["base"] < IDENTIFIER_FIRST - 1 or agent_limit(mode, bus) < 1:
            base.refuse(
                f"must leave agent 1 an identifier within {IDENTIFIER_FIRST:#05x}.."
                f"{IDENTIFIER_LAST:#05x}, not {base.seen}"
            )
    limit = agent_limit(mode, bus)
    if bus["model"] == "can" and agents > limit:
        keys["model"].refuse(
            f"there are identifiers for {limit} agents, not for {agents}; must be ideal for so many"
        )
    return bus


def _check_controllable(places, controllability: gains.Controllability, n: int) -> None:
    plant = places["plant"]
    if controllability.rank < n:
        plant.refuse(
            f"not controllable: [B, AB, ..] has rank {controllability.rank}, must have {n}: "
            "some motion of the plant is out of the input's reach; add an actuator, drop the "
            "states it does not move, or, where sampling hides a motion, change the period"
        )


def _check_condition(places, controllability: gains.Controllability) -> None:
    if controllability.condition <= gains.CONDITION_LIMIT:
        return
    units = controllability.units
    if controllability.scaled_condition <= gains.CONDITION_LIMIT:
        largest, smallest = int(np.argmax(units)) + 1, int(np.argmin(units)) + 1
        cure = (
            f"measure the states in units of like size: state {largest} moves "
            f"{units.max() / units.min():.1g} times as far as state {smallest} for the same input; "
            f"with units that even this out the condition is {controllability.scaled_condition:.1g}"
        )
    else:
        cure = (
            f"a longer sample period, or a model with fewer states (other units alone leave "
            f"{controllability.scaled_condition:.1g})"
        )
    places["plant"].refuse(
        f"the controllability matrix has condition {controllability.condition:.1g}, must be at "
        f"most {gains.CONDITION_LIMIT:.1g}: the gains would lose "
        f"{min(gains.digits_lost(controllability.condition), 16):.0f} of their 16 digits, more "
        f"than half; {cure}"
    )


def _or_automatic(place: Place, automatic: set[str], name: str, read):
    if place.plain == "auto":
        automatic.add(name)
        return None
    return read()


def read(path: Path) -> Request:
    """The request of a file, checked as far as that goes before the automatic numbers are chosen
    (choose.py) and checked with them (check_numbers)."""
    top = document.load(path)
    places = top.section(
        REQUIRED,
        ["period", "fixed"],
    )
    automatic: set[str] = set()
    name = places["name"].text()
    noise = places["noise"].section(["sigma"])
    places["sigma"] = noise["sigma"]
    sigma = noise["sigma"].positive()
    period = places["period"].positive() if "period" in places else None
    A, B, period, integer_plant = _read_plant(places["plant"], period)
    n = len(B)
    controllability = gains.controllability(A, B)
    _check_controllable(places, controllability, n)

    by_roots = "roots" in places["gains"].names
    rows = ["roots"] if by_roots else ["stabilizing", "compression"]
    gain_places = places["gains"].section([*rows, "beta", "gamma", "t0"])
    roots = None
    if by_roots:
        roots = _read_roots(gain_places["roots"], n)
        _check_condition(places, controllability)
        K1, K2 = gains.rows(A, B, roots)
    else:
        K1, K2 = (np.array(gain_places[row].row(n)) for row in rows)
    quantizer = places["quantizer"].section(["threshold", "bound"])
    places |= gain_places | quantizer

    initial = places["initial"].section(["states", "estimates"])
    places |= initial
    state_rows = initial["states"].items("agents", 2)
    initial_states = _read_matrix(state_rows, n)
    for number, row in enumerate(state_rows, 1):
        places[f"states[{number}]"] = row
    agents = len(state_rows)
    graphs, transition = _read_topology(places["topology"], agents)
    mode = places["channel"].section(["mode"])["mode"].choice("link", "broadcast")
    bus = _read_bus(places["bus"], mode, agents)
    fixed = {}
    if "fixed" in places:
        keys = places["fixed"].section(["state_fraction_bits", "control_fraction_bits"])
        places |= keys
        fixed = {key: value.integer(0, 31) for key, value in keys.items()}

    numbers = {
        "beta": lambda: gain_places["beta"].positive(),
        "gamma": lambda: gain_places["gamma"].positive(),
        "t0": lambda: gain_places["t0"].integer(1, CLOCK_LAST - 2),
        "threshold": lambda: quantizer["threshold"].number(),
        "bound": lambda: quantizer["bound"].positive(),
    }
    values = {
        key: _or_automatic(places[key], automatic, key, reader) for key, reader in numbers.items()
    }
    system = System(
        name=name,
        A=A,
        B=B,
        K1=K1,
        K2=K2,
        **values,
        sigma=sigma,
        graphs=graphs,
        transition=transition,
        initial_states=initial_states,
        initial_estimate=initial["estimates"].number(),
        mode=mode,
        bus=bus,
        period=period,
        steps=places["steps"].integer(1, CLOCK_LAST - 2),
        integer_plant=integer_plant,
        fixed=fixed,
    )
    return Request(system, automatic, roots, places, controllability)


def check_numbers(request: Request) -> None:
    """The ranges of what onebit-sim and the library take, once every number is there. For a number
    that was chosen, the refusal says so: its cure lies elsewhere."""
    system, sigma = request.system, request.system.sigma

    def refuse(name: str, what: str, cure: str):
        chosen = f"auto chose {getattr(system, name):.6g}; " if name in request.automatic else ""
        request.refuse(name, f"{chosen}{what}{'; ' + cure if chosen else ''}")

    if not system.bound >= RATIO_MIN * sigma:
        refuse("bound", f"must be at least {RATIO_MIN:g} sigma = {RATIO_MIN * sigma:g}", "")
    reach = (abs(system.threshold) + system.bound) / sigma
    if not reach <= REACH_MAX:
        refuse(
            "bound",
            f"(|threshold| + bound) / sigma is {reach:.4g}, must be at most {REACH_MAX:g}: beyond, "
            "the bits carry nothing",
            f"take sigma from {(abs(system.threshold) + system.bound) / REACH_MAX:.4g}, or initial "
            "states that are closer to zero",
        )
    for number, state in enumerate(system.initial_states, 1):
        compressed = abs(system.K2 @ state)
        # Written so that an overflow to not-a-number is refused too.
        if not compressed <= system.bound * (1 + COMPRESSED_ROUNDING):
            request.refuse(
                f"states[{number}]",
                f"agent {number} has |K2 x| = {compressed:.10g}, must be at most the bound "
                f"{system.bound:.10g}: raise the bound, or let it be auto",
            )
    if not abs(system.initial_estimate) <= system.bound:
        request.refuse(
            "estimates",
            f"must be within the bound -{system.bound:g}..{system.bound:g}, not "
            f"{system.initial_estimate:g}",
        )
    if not RATIO_MIN * sigma <= system.beta <= ESTIMATOR_GAIN_MAX * sigma:
        refuse(
            "beta",
            f"must be from {RATIO_MIN * sigma:g} to {ESTIMATOR_GAIN_MAX:g} sigma = "
            f"{ESTIMATOR_GAIN_MAX * sigma:g}",
            "the theorem's bound asks more than the library holds on this network: join it more "
            "closely, lower the bound, or take --objective fast",
        )
    if not RATIO_MIN <= system.gamma * sigma <= CONTROL_GAIN_MAX:
        refuse(
            "gamma",
            f"must be from {RATIO_MIN / sigma:g} to {CONTROL_GAIN_MAX / sigma:g}",
            "take another sigma",
        )
    if not system.t0 + 1 + system.steps <= CLOCK_LAST:
        request.refuse(
            "steps", f"must be at most {CLOCK_LAST - 1 - system.t0}: the clock ends at 2^32 - 1"
        )
