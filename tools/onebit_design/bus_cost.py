"""What a step costs on a CAN bus: frame lengths, load, group size, shortest step, latencies.

Everything is counted in bit times, interframe space included, from the frames' own contents; the
frames are those of lib/onebit_frame.h, which tests/test_dbc.py compares with the constants here.

Worst cases come in two strengths. *Guaranteed* takes each frame at its own longest, whatever the
agents' clocks say. *In step* uses that all agents number a step alike, so that not all can be at
their longest at once, nor all and SYNC, whose counter is that number too; it is exact, and
onebit-sim reaches it.
"""

import math

import numpy as np

from onebit_design.network import stationary

PAYLOAD_BASE = 0x100
IDENTIFIER_BASE = 0x400
LINK_BASE = 0x10000000
SYNC_IDENTIFIER = 0x080
STEP_MODULUS = 128
SENDER_SHIFT = 14
RECEIVER_SHIFT = 1
IDENTIFIER_LAST = 0x7EF  # of 11 bits; above it CiA 301 reserves
LINK_AGENT_LAST = 0x1FFF

CRC_POLYNOMIAL = 0x4599  # without its highest term
CRC_BITS = 15
RUN_BITS = 5  # after so many equal bits the sender stuffs one of the other value
INTERFRAME_BITS = 3
# Not stuffed: CRC delimiter, acknowledgement slot and delimiter, end of frame.
TRAILER_BITS = 1 + 2 + 7 + INTERFRAME_BITS

# Identifiers looked at together, so that 32,000 links do not need gigabytes.
CHUNK = 2048
# Of the report's table.
TABLE_ROWS = 16
NAME_WIDTH = 19  # 8191 to 8190, bit 0


def frame_bits(identifier, data=None, extended=False):
    """Bits on the wire of classical CAN data frames, interframe space included.

    Bit by bit as ISO 11898-1 has it. Identifier and data (None: no data byte) are integers or NumPy
    arrays that broadcast against each other; so is the result.
    """
    identifier = np.asarray(identifier, dtype=np.uint32)
    if extended:
        fields = [(0, 1), (identifier >> 18, 11), (3, 2), (identifier & 0x3FFFF, 18), (0, 3)]
    else:
        fields = [(0, 1), (identifier, 11), (0, 3)]
    fields.append((0 if data is None else 1, 4))
    if data is not None:
        fields.append((data, 8))

    crc = np.zeros(1, dtype=np.uint16)
    last = np.ones(1, dtype=np.uint8)  # the idle bus before the start of frame is recessive
    run = np.zeros(1, dtype=np.uint8)
    stuffed = np.zeros(1, dtype=np.uint8)
    count = 0

    def send(value, width):
        nonlocal last, run, stuffed, count
        for place in reversed(range(width)):
            bit = (np.asarray(value) >> place & 1).astype(np.uint8)
            run = np.where(bit == last, run + np.uint8(1), np.uint8(1))
            full = run == RUN_BITS
            # The stuff bit has the other value and is itself the first of a new run.
            stuffed = stuffed + full
            last = bit ^ full
            run[full] = 1
            count += 1
            yield bit

    for value, width in fields:
        for bit in send(value, width):
            feedback = (crc >> (CRC_BITS - 1)).astype(np.uint16) & 1 ^ bit
            crc = (crc << 1 & 0x7FFF) ^ feedback * np.uint16(CRC_POLYNOMIAL)
    for _ in send(crc, CRC_BITS):
        pass
    bits = stuffed.astype(np.int64) + count + TRAILER_BITS
    return bits.reshape(np.broadcast_shapes(identifier.shape, np.shape(data)))


def sync_bits():
    """Lengths of SYNC by step residue; its counter is the residue, with 128 for 0."""
    counters = np.arange(STEP_MODULUS)
    counters[0] = STEP_MODULUS
    return frame_bits(SYNC_IDENTIFIER, counters)


def base_of(bus):
    """The base of a bus section's 11-bit identifiers."""
    default = PAYLOAD_BASE if bus["encoding"] == "payload" else IDENTIFIER_BASE
    return bus.get("base", default)


def agent_limit(mode, bus):
    """Largest agent number that the identifiers can carry."""
    if mode == "link":
        return LINK_AGENT_LAST
    room = IDENTIFIER_LAST - base_of(bus)
    return room if bus["encoding"] == "payload" else max(0, (room - 1) // 2)


def messages(system, graph=None):
    """Sender, receiver (0: all) and identifier of a step's messages, in priority order.

    The identifier is that of the bit 0. Of one graph or, without it, of all. Agents beyond the
    identifiers have no frame, as in onebit-sim on the ideal bus.
    """
    limit = agent_limit(system.mode, system.bus)
    if system.mode == "broadcast":
        factor = 1 if system.bus["encoding"] == "payload" else 2
        base = base_of(system.bus)
        return [(k, 0, base + factor * k) for k in range(1, min(system.agents, limit) + 1)]
    if graph is None:
        links = system.links
    else:
        edges = system.graphs[graph]
        links = sorted({(a, b) for a, b in edges} | {(b, a) for a, b in edges})
    return [
        (a, b, LINK_BASE + (a << SENDER_SHIFT) + (b << RECEIVER_SHIFT))
        for a, b in links
        if max(a, b) <= limit
    ]


def message_bits(identifiers, extended, encoding):
    """Lengths of messages: identifiers x step residues x bit.

    In identifier form nothing depends on the step, and there is one residue.
    """
    identifiers = np.asarray(identifiers, dtype=np.uint32).reshape(-1, 1)
    payload = encoding == "payload"
    shape = (0, STEP_MODULUS if payload else 1, 2)
    parts = [np.empty(shape, dtype=np.int64)]
    for start in range(0, len(identifiers), CHUNK):
        part = identifiers[start : start + CHUNK]
        if payload:
            bits = frame_bits(part, np.arange(2 * STEP_MODULUS), extended)
        else:
            bits = frame_bits(part + np.arange(2, dtype=np.uint32), None, extended)
        parts.append(bits.reshape(-1, *shape[1:]))
    return np.concatenate(parts)


def response_times(lengths, periods, blocking=None):
    """Worst-case response times on CAN, in the order of priority, highest first.

    R. I. Davis, A. Burns, R. J. Bril, J. J. Lukkien: Controller Area Network (CAN) schedulability
    analysis: refuted, revisited and revised. Real-Time Systems 35 (2007) 239-272, without
    queueing jitter. Lengths and periods in bit times; the response counts from when a frame is
    queued to the end of its interframe space. Blocking is by the longest frame of lower priority
    unless given. Infinity where the frame and those above it ask for the whole bus or more.
    """
    lengths = np.asarray(lengths, dtype=float)
    periods = np.asarray(periods, dtype=float)
    if blocking is None:
        below = np.append(lengths[1:], 0.0)
        blocking = np.maximum.accumulate(below[::-1])[::-1]
    # Work of the frames above, a column for each distinct period: few, so all frames at once.
    distinct = np.unique(periods)
    own = np.where(periods[:, None] == distinct, lengths[:, None], 0.0)
    with_own = own.cumsum(axis=0)
    above = with_own - own
    result = np.full(len(lengths), np.inf)
    sure = np.flatnonzero((with_own / distinct).sum(axis=1) < 1 - 1e-12)

    def fixed_point(constant, work, extra, start):
        while True:
            following = constant + (np.ceil((start[:, None] + extra) / distinct) * work).sum(axis=1)
            if np.array_equal(following, start):
                return start
            start = following

    blocking, own_length = np.broadcast_to(blocking, len(lengths))[sure], lengths[sure]
    busy = fixed_point(blocking, with_own[sure], 0, own_length)
    instances = np.ceil(busy / periods[sure]).astype(int)
    longest = np.zeros(len(sure))
    for instance in range(instances.max(initial=0)):
        alive = instances > instance
        constant = (blocking + instance * own_length)[alive]
        # One bit time: a frame that is queued while another's first bit is sent has lost.
        wait = fixed_point(constant, above[sure][alive], 1, constant)
        response = wait - instance * periods[sure][alive] + own_length[alive]
        longest[alive] = np.maximum(longest[alive], response)
    result[sure] = longest
    return result


def largest_count(longest, room):
    """How many frames, in the order given, fit into `room` bit times."""
    return int(np.searchsorted(np.cumsum(longest), room, side="right"))


def bus_cost(system):
    """The cost of a system's messages on CAN, as numbers and lists for JSON; times in seconds.

    Loads are parts of 1. `graphs` has an entry for each graph of the topology, one in broadcast
    where all agents send in any graph. `frames` has an entry for each identifier, highest priority
    first; its `response` follows `response_times` (None: longer than the period, so the frame can
    be late), `latency` is the worst that onebit-sim's bus gives, from the end of SYNC.
    """
    mode, bus = system.mode, system.bus
    encoding, bitrate = bus["encoding"], float(bus["bitrate"])
    extended = mode == "link"
    sync = sync_bits()
    longest_sync = int(sync.max())
    period_bits = round(system.period * bitrate, 6)  # 0.0011 s * 500000 bit/s is 550
    # Steps begin at whole bit times, so the shortest has its fraction cut off.
    room = math.floor(period_bits)

    everything = messages(system)
    bits = message_bits([row[2] for row in everything], extended, encoding)
    longest = bits.max(axis=(1, 2), initial=0)
    place = {row[2]: k for k, row in enumerate(everything)}

    several = mode == "link" and len(system.graphs) > 1
    members = (
        [[place[row[2]] for row in messages(system, graph)] for graph in range(len(system.graphs))]
        if mode == "link"
        else [list(range(len(everything)))]
    )
    law = stationary(np.asarray(system.transition, dtype=float)) if several else np.ones(1)
    graphs = []
    for member, share in zip(members, law, strict=True):
        own = bits[member]
        graphs.append(
            {
                "frames": len(member) + 1,
                "share": float(share),
                "bits_guaranteed": longest_sync + int(longest[member].sum()),
                "bits_in_step": int((sync + own.max(axis=2).sum(axis=0)).max()),
                "bits_mean": float(sync.mean() + own.mean(axis=(1, 2)).sum()),
            }
        )
    worst = max(range(len(graphs)), key=lambda graph: graphs[graph]["bits_guaranteed"])
    guaranteed = graphs[worst]["bits_guaranteed"]
    in_step = max(graph["bits_in_step"] for graph in graphs)
    mean = sum(graph["share"] * graph["bits_mean"] for graph in graphs)

    by_identifier = agent_limit(mode, bus)
    if mode == "broadcast":
        factor = 1 if encoding == "payload" else 2
        candidates = base_of(bus) + factor * np.arange(1, by_identifier + 1)
        candidate_bits = message_bits(candidates, extended, encoding).max(axis=(1, 2), initial=0)
        by_period = largest_count(candidate_bits, room - longest_sync)
    elif len(members[worst]) > 0:
        by_period = int((room - longest_sync) * system.agents // (guaranteed - longest_sync))
    else:
        by_period = by_identifier
    by_period = max(0, min(by_period, by_identifier))

    return {
        "mode": mode,
        "encoding": encoding,
        "bitrate": bitrate,
        "period": float(system.period),
        "graphs": graphs,
        "worst_graph": worst + 1,
        "load_guaranteed": guaranteed / period_bits,
        "load_in_step": in_step / period_bits,
        "load_mean": mean / period_bits,
        "shortest_period": guaranteed / bitrate,
        "shortest_period_in_step": in_step / bitrate,
        "fits": bool(guaranteed <= room and system.agents <= by_identifier),
        "agents": system.agents,
        "agents_by_identifier": by_identifier,
        "agents_by_period": by_period,
        "agents_largest": min(by_identifier, by_period),
        "frames": frame_rows(system, everything, bits, members, period_bits, guaranteed <= room),
    }


def frame_rows(system, everything, bits, members, period_bits, fits):
    """What bus_cost says of each identifier."""
    bitrate = float(system.bus["bitrate"])
    sync = sync_bits()
    longest = bits.max(axis=(1, 2), initial=0)
    response = np.zeros(len(everything))
    latency = np.zeros(len(everything), dtype=np.int64)
    sync_blocking = longest.max(initial=0)
    for member in members:
        lengths = np.append(sync.max(), longest[member])
        below = np.append(longest[1:], 0)
        blocking = np.maximum.accumulate(below[::-1])[::-1][member]
        if len(members) > 1 and not fits:
            # An overfull graph's leavings may be of any priority when the next graph begins.
            blocking = np.full(len(member), sync_blocking)
        periods = np.full(len(lengths), period_bits)
        own = response_times(lengths, periods, np.append(sync_blocking, blocking))[1:]
        response[member] = np.maximum(response[member], own)
        in_turn = bits[member].max(axis=2).cumsum(axis=0).max(axis=1, initial=0)
        latency[member] = np.maximum(latency[member], in_turn - INTERFRAME_BITS)

    def seconds(bit_times):
        return float(bit_times) / bitrate

    def response_seconds(bit_times):
        return seconds(bit_times) if bit_times <= period_bits else None

    longest_sync = int(sync.max())
    rows = [
        {
            "identifier": SYNC_IDENTIFIER,
            "extended": False,
            "sender": 0,
            "receiver": 0,
            "bit": None,
            "bits_min": int(sync.min()),
            "bits_mean": float(sync.mean()),
            "bits_max": longest_sync,
            "response": response_seconds(float(sync_blocking + longest_sync)),
            "latency": seconds(longest_sync - INTERFRAME_BITS),
        }
    ]
    payload = system.bus["encoding"] == "payload"
    for k, (sender, receiver, identifier) in enumerate(everything):
        # In identifier form a message has two identifiers, of which a step sees one.
        for bit in [None] if payload else [0, 1]:
            own = bits[k] if payload else bits[k, 0, bit]
            shorter = int(longest[k]) - int(own.max())
            rows.append(
                {
                    "identifier": identifier + (bit or 0),
                    "extended": system.mode == "link",
                    "sender": sender,
                    "receiver": receiver,
                    "bit": bit,
                    "bits_min": int(own.min()),
                    "bits_mean": float(own.mean()),
                    "bits_max": int(own.max()),
                    "response": response_seconds(response[k] - shorter),
                    "latency": seconds(int(latency[k]) - shorter),
                }
            )
    return rows


def time_text(seconds):
    if seconds is None:
        return "may be late"
    return f"{1e3 * seconds:.3f} ms"


def bits_text(row):
    """Lengths of a frame as a range, or one number where they are alike."""
    if row["bits_min"] == row["bits_max"]:
        return f"{row['bits_max']}"
    return f"{row['bits_min']}..{row['bits_max']}"


def report_lines(costs):
    """The cost as text for the terminal."""
    link = costs["mode"] == "link"
    graphs = costs["graphs"]
    worst = graphs[costs["worst_graph"] - 1]
    frames = costs["frames"]
    lines = [
        f"Network: CAN at {costs['bitrate'] / 1000:g} kbit/s, {costs['mode']} mode, "
        f"{costs['encoding']} encoding, a step every {1000 * costs['period']:g} ms",
        f"  frames a step        {worst['frames']}, SYNC among them"
        + (f" (graph {costs['worst_graph']}, the worst of {len(graphs)})" if graphs[1:] else ""),
        f"  frame length         {min(row['bits_min'] for row in frames)}.."
        f"{max(row['bits_max'] for row in frames)} bits with stuffing and interframe space; "
        f"SYNC {bits_text(frames[0])}",
        f"  bus load             guaranteed {100 * costs['load_guaranteed']:.3g} %, with clocks in "
        f"step {100 * costs['load_in_step']:.3g} %, mean {100 * costs['load_mean']:.3g} %",
        f"  shortest step        {time_text(costs['shortest_period'])}, with clocks in step "
        f"{time_text(costs['shortest_period_in_step'])}",
        f"  largest group        {costs['agents_largest']} agents (identifiers: "
        f"{costs['agents_by_identifier']}; period: {costs['agents_by_period']}"
        + (" at this mean degree)" if link else ")"),
    ]
    if costs["agents"] > costs["agents_by_identifier"]:
        lines.append(
            f"  FAILS: {costs['agents']} agents, identifiers for {costs['agents_by_identifier']}; "
            "the figures are for those that have one"
        )
    if costs["shortest_period"] > costs["period"]:
        lines.append(
            "  FAILS: the worst case does not fit into the period; lengthen the period, raise the "
            "bit rate" + (" or use broadcast" if link else "")
        )
    lines += [
        "  Worst-case latency. response: Davis, Burns, Bril, Lukkien 2007, from queueing to the",
        "  end of the interframe space; SYNC and all frames queued together every period without",
        "  jitter, deadline = period, blocked once by the longest frame of lower priority (one of",
        "  the period before, still on the wire). simulator: from the end of SYNC (SYNC: from the",
        "  period's begin) to the end of frame, clocks in step, nothing left from the period",
        "  before. Neither knows of error frames.",
        f"  {'identifier':<10}  {'message':<{NAME_WIDTH}}  {'bits':<6}  {'mean':>4}"
        f"  {'response':>11}  {'simulator':>11}",
    ]
    shown = frames if len(frames) <= TABLE_ROWS else [*frames[: TABLE_ROWS - 1], None, frames[-1]]
    lines += [frame_line(row, len(frames) - TABLE_ROWS) for row in shown]
    return lines


def frame_line(row, left_out):
    if row is None:
        return f"  ... {left_out} more"
    name = f"agent {row['sender']}" if row["sender"] else "SYNC"
    if row["receiver"]:
        name = f"{row['sender']} to {row['receiver']}"
    if row["bit"] is not None:
        name += f", bit {row['bit']}"
    identifier = f"0x{row['identifier']:0{8 if row['extended'] else 3}x}"
    return (
        f"  {identifier:<10}  {name:<{NAME_WIDTH}}  {bits_text(row):<6}  {row['bits_mean']:>4.1f}"
        f"  {time_text(row['response']):>11}  {time_text(row['latency']):>11}"
    )
