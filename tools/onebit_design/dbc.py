"""The bus as a DBC file: what lib/onebit_frame.h says, for CAN tools to show bits and steps."""

import cantools.database

from onebit_design.bus_cost import LINK_AGENT_LAST, STEP_MODULUS, SYNC_IDENTIFIER, messages

MASTER = "master"
MANAGEMENT_IDENTIFIER = 0x000  # CANopen's network management
# GenMsgCycleTime counts whole milliseconds in 16 bits.
CYCLE_TIME_LAST = 0xFFFF


def cycle_time(period):
    """The period in milliseconds, None where a whole number does not give it."""
    milliseconds = round(1000 * period, 9)
    if milliseconds == int(milliseconds) and 1 <= milliseconds <= CYCLE_TIME_LAST:
        return int(milliseconds)
    return None


def version_text(name):
    """A name as a DBC string, which has no way to escape a quote and no agreed encoding."""
    return "".join(
        letter if letter.isascii() and letter.isprintable() and letter not in '"\\' else "?"
        for letter in name
    )


def signals(receivers):
    return [
        cantools.database.can.Signal(
            "bit",
            start=0,
            length=1,
            minimum=0,
            maximum=1,
            comment="1 where the sender's K2 x with noise was at most the threshold.",
            receivers=receivers,
        ),
        cantools.database.can.Signal(
            "step",
            start=1,
            length=7,
            minimum=0,
            maximum=STEP_MODULUS - 1,
            comment="The clock t modulo 128.",
            receivers=receivers,
        ),
    ]


def sync_signal(receivers):
    return cantools.database.can.Signal(
        "counter",
        start=0,
        length=8,
        minimum=1,
        maximum=STEP_MODULUS,
        comment=f"The step's clock t modulo {STEP_MODULUS}, with {STEP_MODULUS} for 0.",
        receivers=receivers,
    )


def management_signals(receivers):
    return [
        cantools.database.can.Signal(
            name,
            start=start,
            length=8,
            minimum=0,
            maximum=255,
            comment=comment,
            receivers=receivers,
        )
        for name, start, comment in [
            ("command", 0, "1: start, 2: stop, 128: pre-operational, as stop. Others do nothing."),
            ("node", 8, "CiA 301's node-ID, 1 to 127, of the node that it is for; 0: all."),
        ]
    ]


def dbc_text(system):
    """The DBC file of a system's bus, always the same bytes for the same system.

    None in identifier form: there the bit stands in the identifier and the step nowhere, and DBC
    describes data alone. Agents beyond the identifiers have no frame and no message here either.
    """
    if system.bus["encoding"] != "payload":
        return None
    cycle = cycle_time(system.period)
    every = f"every {1000 * system.period:.10g} ms"
    neighbours = {}
    for sender, receiver in system.links:
        neighbours.setdefault(sender, []).append(f"agent_{receiver}")
    rows = messages(system)
    if system.mode == "link":
        agents = range(1, min(system.agents, LINK_AGENT_LAST) + 1)
    else:
        agents = [sender for sender, _, _ in rows]
    names = [f"agent_{agent}" for agent in agents]
    known = set(names)

    described = [
        cantools.database.can.Message(
            SYNC_IDENTIFIER,
            "SYNC",
            length=1,
            signals=[sync_signal(names)],
            senders=[MASTER],
            cycle_time=cycle,
            comment=f"Begins a step, {every}. CANopen's SYNC (CiA 301).",
        ),
        cantools.database.can.Message(
            MANAGEMENT_IDENTIFIER,
            "network_management",
            length=2,
            signals=management_signals(names),
            senders=[MASTER],
            comment="Stops and starts agents. CANopen's network management (CiA 301).",
        ),
    ]
    for sender, receiver, identifier in rows:
        if receiver:
            name, receivers = f"message_{sender}_to_{receiver}", [f"agent_{receiver}"]
            comment = f"Agent {sender}'s bit for agent {receiver}, once a step"
        else:
            name = f"message_{sender}"
            receivers = [other for other in neighbours.get(sender, []) if other in known]
            comment = f"Agent {sender}'s bit for all its neighbours, once a step"
        if len(system.graphs) > 1:
            comment += " in which its link is on" if receiver else ", whatever links are on"
        described.append(
            cantools.database.can.Message(
                identifier,
                name,
                length=1,
                signals=signals(receivers),
                senders=[f"agent_{sender}"],
                cycle_time=cycle,
                comment=f"{comment} ({every}).",
                is_extended_frame=system.mode == "link",
            )
        )
    nodes = [cantools.database.can.Node(MASTER, comment="Sends SYNC; may be one of the agents.")]
    nodes += [cantools.database.can.Node(name) for name in names]
    database = cantools.database.can.Database(described, nodes, version=version_text(system.name))
    # cantools ends lines as Windows does.
    return database.as_dbc_string().replace("\r\n", "\n")
