"""tools/onebit_design/bus_cost.py: known answers, and onebit-sim on its bit-exact CAN bus.

The simulator takes frame lengths from tables in C and knows nothing of the analysis. Where a worst
case is to be reached, agents stand still at the edges of the bound, so that each sends the same bit
in (nearly) every step, and a seed is used with which they all do where it matters.
"""

import json
import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from simulator import SCENARIOS, run, summary

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tools"))

from onebit_design.bus_cost import (
    INTERFRAME_BITS,
    bus_cost,
    frame_bits,
    message_bits,
    messages,
    report_lines,
    response_times,
    sync_bits,
)
from onebit_design.system import System

SYNC = 0x080
SYNC_BITS = range(57, 60)  # by its counter
SYNC_MEAN = 7371 / 128
MODES = ["link", "broadcast"]
ENCODINGS = ["payload", "identifier"]
KINDS = [(mode, encoding) for mode in MODES for encoding in ENCODINGS]


def system_of(content):
    """What the design tool would hold after it has read this scenario."""
    plant, gains, topology = content["plant"], content["gains"], content["topology"]
    return System(
        name=content["name"],
        A=np.array(plant["A"], dtype=float),
        B=np.array(plant["B"], dtype=float),
        K1=np.array(gains["stabilizing"], dtype=float),
        K2=np.array(gains["compression"], dtype=float),
        beta=gains["beta"],
        gamma=gains["gamma"],
        t0=gains["t0"],
        threshold=content["quantizer"]["threshold"],
        bound=content["quantizer"]["bound"],
        sigma=content["noise"]["sigma"],
        graphs=[[tuple(edge) for edge in graph["edges"]] for graph in topology["graphs"]],
        transition=np.array(topology.get("transition", [[1]]), dtype=float),
        initial_states=np.array(content["initial"]["states"], dtype=float),
        initial_estimate=content["initial"]["estimates"],
        mode=content["channel"]["mode"],
        bus=content["bus"],
        period=content["period"],
        steps=content["steps"],
    )


def aircraft(name, mode, encoding, **bus):
    content = yaml.safe_load((SCENARIOS / f"{name}.yaml").read_text())
    content["channel"]["mode"] = mode
    content["bus"] = {"model": "can", "bitrate": 500000, "encoding": encoding, **bus}
    return content


def pairs(agents):
    """Each agent has one link, so that in link mode too it sends one bit a step."""
    return [[k, k + 1] for k in range(1, agents, 2)]


def still(mode, encoding, bits, period_bits, edges=None, **more):
    """Agents that stay at the bound, where almost every noise gives agent k the bit bits[k - 1]."""
    agents = len(bits)
    return {
        "name": "still",
        "plant": {"A": [[1]], "B": [1]},
        "gains": {"stabilizing": [0], "compression": [1], "beta": 1, "gamma": 1e-6, "t0": 10},
        "quantizer": {"threshold": 0, "bound": 4},
        "noise": {"sigma": 1},
        "topology": {"graphs": [{"edges": edges or pairs(agents)}]},
        "initial": {"states": [[-4 if bit else 4] for bit in bits], "estimates": 0},
        "channel": {"mode": mode},
        "bus": {"model": "can", "bitrate": 1000000, "encoding": encoding, **more},
        "period": period_bits / 1e6,
        "steps": 300,
    }


def worst_bits(mode, encoding, agents, first=None):
    """The bits with which the first messages last longest in some step; else all and SYNC."""
    system = system_of(still(mode, encoding, [0] * agents, 1e6))
    rows = messages(system)
    bits = message_bits([row[2] for row in rows], mode == "link", encoding)
    before = sync_bits() if first is None else np.zeros(1)
    residue = (before + bits[:first].max(axis=2).sum(axis=0)).argmax()
    # In identifier form a message is the same in all steps.
    return bits[:, residue % bits.shape[1]].argmax(axis=1).tolist()


def simulate(tmp_path, content, **options):
    """Summary and frames (time, identifier, extended, data) of a run, times in bits."""
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump(content))
    run(path, out=tmp_path / "out", log=tmp_path / "bus.log", **options)
    form = re.compile(r"\((\d+)\.(\d{6})\) \S+ ([0-9A-F]+)#([0-9A-F]*)")
    frames = []
    for line in (tmp_path / "bus.log").read_text().splitlines():
        seconds, fraction, identifier, data = form.fullmatch(line).groups()
        time = int(seconds + fraction) * content["bus"]["bitrate"] / 1e6
        assert time == int(time)
        frames.append((int(time), int(identifier, 16), len(identifier) == 8, bytes.fromhex(data)))
    return summary(tmp_path / "out"), frames


def lengths(frames):
    """Lengths of a log's frames, of each kind all at once."""
    result = np.zeros(len(frames), dtype=int)
    kinds = [(extended, len(data)) for _, _, extended, data in frames]
    for extended, count in set(kinds):
        places = [k for k, kind in enumerate(kinds) if kind == (extended, count)]
        identifiers = np.array([frames[k][1] for k in places])
        data = np.array([frames[k][3][0] for k in places]) if count else None
        result[places] = frame_bits(identifiers, data, extended)
    return result.tolist()


def syncs_of(frames):
    """End and length of each SYNC."""
    syncs = [frame for frame in frames if frame[1] == SYNC]
    return [(frame[0], length) for frame, length in zip(syncs, lengths(syncs), strict=True)]


def sync_delays(frames, period_bits):
    """By how many bit times each SYNC was late."""
    return [
        time - step * period_bits - length + INTERFRAME_BITS
        for step, (time, length) in enumerate(syncs_of(frames))
    ]


# --- lengths ---


def test_all_standard_frames():
    every = np.arange(2048)
    empty = frame_bits(every)
    assert (empty.min(), empty.max(), round(empty.mean(), 3)) == (48, 53, 48.969)
    one = frame_bits(every[:, None], np.arange(256))
    assert one.shape == (2048, 256)
    assert (one.min(), one.max(), round(one.mean(), 3)) == (56, 62, 57.018)


def test_extended_frames_at_random():
    random = np.random.default_rng(1)
    identifiers = random.integers(0, 2**29, 200_000)
    empty = frame_bits(identifiers, extended=True)
    # The deviation of a length is about 1.4 bits: 0.02 is more than six standard errors.
    assert empty.mean() == pytest.approx(69.738, abs=0.02)
    assert empty.min() >= 67 + 1
    assert empty.max() <= 78
    one = frame_bits(identifiers, random.integers(0, 256, len(identifiers)), extended=True)
    assert one.mean() == pytest.approx(77.8, abs=0.05)


def test_lengths_by_hand():
    # 34 dominant bits (the CRC of zeros is zero), a stuff bit after each five, 13 of fixed form.
    assert frame_bits(0) == 34 + 6 + 13
    # 0 00010000000 000 0001 00000001 and the CRC 000011000000001: five zeros end twice between the
    # identifier's one and the length's, once in the data and once in the CRC.
    assert frame_bits(SYNC, 1) == 19 + 8 + 15 + 4 + 13


@pytest.mark.parametrize(("mode", "encoding"), KINDS)
@pytest.mark.parametrize("name", ["aircraft-fixed", "aircraft-markov"])
def test_lengths_and_latencies_of_a_run(tmp_path, name, mode, encoding):
    """Every frame of 400 steps: its length counts, it is foreseen and is never later than said."""
    content = aircraft(name, mode, encoding)
    costs = bus_cost(system_of(content))
    result, frames = simulate(tmp_path, content, steps=400, seed=3)
    foreseen = {row["identifier"]: row for row in costs["frames"]}
    assert list(foreseen) == sorted(foreseen)  # highest priority first
    assert {identifier for _, identifier, _, _ in frames} == set(foreseen)

    total = 0
    latest = 0
    for (time, identifier, extended, _), bits in zip(frames, lengths(frames), strict=True):
        row = foreseen[identifier]
        assert row["bits_min"] <= bits <= row["bits_max"]
        assert row["extended"] == extended
        total += bits
        begin = time // 250_000 * 250_000
        if identifier == SYNC:
            after_sync = begin + bits
        else:
            begin = after_sync
        assert time - begin <= round(row["latency"] * 500_000)
        if identifier != SYNC:
            latest = max(latest, time - begin)
        assert row["latency"] < row["response"]
    assert result["frames"] == len(frames)
    assert result["wire_bits"] == total
    assert round(result["latency_max"] * 500_000) == latest
    assert result["bus_load"] <= costs["load_in_step"] <= costs["load_guaranteed"]


@pytest.mark.parametrize(("mode", "encoding"), KINDS)
def test_rows_are_over_all_payloads(mode, encoding):
    costs = bus_cost(system_of(aircraft("aircraft-fixed", mode, encoding)))
    sync = costs["frames"][0]
    assert (sync["bits_min"], sync["bits_max"]) == (SYNC_BITS[0], SYNC_BITS[-1])
    assert sync["bits_mean"] == SYNC_MEAN == frame_bits(SYNC, np.arange(1, 129)).mean()
    for row in costs["frames"][1:]:
        payloads = np.arange(256) if encoding == "payload" else None
        bits = frame_bits(row["identifier"], payloads, mode == "link")
        assert (row["bits_min"], row["bits_max"]) == (bits.min(), bits.max())
        assert row["bits_mean"] == pytest.approx(bits.mean(), rel=1e-12)


# --- loads ---


@pytest.mark.parametrize(("mode", "encoding"), KINDS)
def test_mean_load_is_that_of_a_long_run(tmp_path, mode, encoding):
    """Two graphs of unlike size, in use 80 % and 20 % of the steps; bits like a fair coin's."""
    content = still(mode, encoding, [0] * 6, 2000)
    content["initial"]["states"] = [[0]] * 6
    content["topology"] = {
        "graphs": [{"edges": [[1, 2]]}, {"edges": [[1, 2], [3, 4], [5, 6], [2, 3], [4, 5]]}],
        "transition": [[0.9, 0.1], [0.4, 0.6]],
    }
    costs = bus_cost(system_of(content))
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump(content))
    run(path, out=tmp_path, steps=60_000)
    assert summary(tmp_path)["bus_load"] == pytest.approx(costs["load_mean"], rel=0.02)
    if mode == "link":
        assert [graph["share"] for graph in costs["graphs"]] == pytest.approx([0.8, 0.2])
        assert [graph["frames"] for graph in costs["graphs"]] == [3, 11]
        assert costs["worst_graph"] == 2
    else:
        assert [graph["frames"] for graph in costs["graphs"]] == [7]


def test_known_costs_of_the_aircraft():
    """Bits a step: SYNC, and frames of the lengths that the other tests hold against the bus."""
    bits = {
        ("aircraft-fixed", "link", "payload"): (1724, 1705, 1671.406),
        ("aircraft-fixed", "link", "identifier"): (1523, 1523, 1513.086),
        ("aircraft-fixed", "broadcast", "payload"): (482, 475, 461.418),
        ("aircraft-fixed", "broadcast", "identifier"): (409, 409, 404.086),
        ("aircraft-markov", "link", "payload"): (724, 716, 595.526),
        ("aircraft-markov", "link", "identifier"): (644, 644, 542.753),
    }
    for (name, mode, encoding), (guaranteed, in_step, mean) in bits.items():
        costs = bus_cost(system_of(aircraft(name, mode, encoding)))
        assert costs["load_guaranteed"] * 250_000 == pytest.approx(guaranteed, abs=1e-6)
        assert costs["load_in_step"] * 250_000 == pytest.approx(in_step, abs=1e-6)
        assert costs["load_mean"] * 250_000 == pytest.approx(mean, abs=1e-3)
        assert costs["shortest_period"] == pytest.approx(guaranteed / 500_000)
        assert costs["fits"]


# --- latencies ---


def worst_seen(lengths, periods, offsets, end):
    """Longest responses on a bus of whole bit times with these first releases."""
    queue = sorted(
        (release, priority)
        for priority, (period, offset) in enumerate(zip(periods, offsets, strict=True))
        for release in range(offset, end, period)
    )
    seen = [0] * len(lengths)
    now = 0
    while queue:
        ready = [entry for entry in queue if entry[0] <= now]
        if not ready:
            now = queue[0][0]
            continue
        entry = min(ready, key=lambda entry: (entry[1], entry[0]))
        queue.remove(entry)
        now += lengths[entry[1]]
        seen[entry[1]] = max(seen[entry[1]], now - entry[0])
    return seen


def test_example_of_davis_burns_bril_lukkien():
    """Three frames of 1 ms every 2.5, 3.5 and 3.5 ms (here 250 bits, so that all are whole).

    The third's second instance takes longer than its first, 3.5 ms to 3, which the analysis before
    theirs overlooked; with a deadline of 3.25 ms it is late. On the bus: all released at once.
    """
    bounds = response_times([250] * 3, [625, 875, 875])
    assert bounds.tolist() == [500, 750, 875]
    assert worst_seen([250] * 3, [625, 875, 875], [0] * 3, 4000)[2] == 875
    first = worst_seen([250] * 3, [625, 875, 875], [0] * 3, 800)
    assert first[2] == 750


def test_responses_bound_any_releases():
    """Random sets of frames with random first releases; nearly always some bound is reached."""
    random = np.random.default_rng(5)
    tight = 0
    for _ in range(60):
        count = int(random.integers(2, 5))
        lengths = random.integers(2, 9, count)
        periods = random.integers(count * 6, count * 20, count)
        bounds = response_times(lengths, periods)
        assert np.isfinite(bounds).all() == ((lengths / periods).sum() < 1)
        reached = False
        for k in range(12):
            # First all together after the longest lower frame has just begun, then at random.
            offsets = random.integers(0, periods) if k else np.zeros(count, dtype=int)
            seen = worst_seen(lengths.tolist(), periods.tolist(), offsets.tolist(), 600)
            assert (seen <= bounds).all()
            reached = reached or (seen == bounds).any()
        tight += reached
    assert tight >= 50


def test_responses_of_an_overfull_bus():
    """The frames that the bus can carry keep their bound, the others have none."""
    bounds = response_times([60, 60, 60], [150, 150, 150])
    assert bounds.tolist() == [120, 180, math.inf]


@pytest.mark.parametrize(("mode", "encoding"), KINDS)
def test_responses_are_blocking_and_all_before(mode, encoding):
    """Released together with room for all, the analysis is a sum."""
    costs = bus_cost(system_of(aircraft("aircraft-fixed", mode, encoding)))
    by_message = {}
    for row in costs["frames"]:
        by_message.setdefault((row["sender"], row["receiver"]), []).append(row)
    longest = [max(row["bits_max"] for row in rows) for rows in by_message.values()]
    for k, rows in enumerate(by_message.values()):
        blocking = max(longest[k + 1 :], default=0)
        for row in rows:
            bits = blocking + sum(longest[:k]) + row["bits_max"]
            assert row["response"] * 500_000 == pytest.approx(bits)


@pytest.mark.parametrize("name", ["aircraft-fixed", "aircraft-markov"])
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_responses_hold_in_a_period_too_short(tmp_path, name, encoding):
    """Frames that have a bound keep it, though SYNC waits for what the period before left."""
    content = aircraft(name, "link", encoding)
    period_bits = round(0.8 * 500_000 * bus_cost(system_of(content))["shortest_period"])
    content["period"] = period_bits / 500_000
    costs = bus_cost(system_of(content))
    bounds = {row["identifier"]: row["response"] for row in costs["frames"]}
    assert 4 < sum(bound is not None for bound in bounds.values()) < len(bounds)
    result, frames = simulate(tmp_path, content, steps=1000)
    assert result["late_frames"] > 0
    syncs = 0
    for time, identifier, _, _ in frames:
        syncs += identifier == SYNC
        since = time - (syncs - 1) * period_bits + INTERFRAME_BITS
        if bounds[identifier] is not None:
            assert since <= round(bounds[identifier] * 500_000)
    assert syncs == 1000
    assert max(sync_delays(frames, period_bits)) > 0


@pytest.mark.parametrize(
    ("mode", "encoding", "other"),
    [(*kind, False) for kind in KINDS] + [(mode, "identifier", True) for mode in MODES],
)
@pytest.mark.parametrize("first", [4, 8])
def test_latency_is_reached(tmp_path, mode, encoding, other, first):
    """The latency of a message in the middle and of the last, to the bit; of both identifiers."""
    bits = worst_bits(mode, encoding, 8, first)
    if other:
        bits[first - 1] = 1 - bits[first - 1]
    content = still(mode, encoding, bits, 2000)
    costs = bus_cost(system_of(content))
    _, frames = simulate(tmp_path, content)
    own = bits[first - 1] if encoding == "identifier" else 0
    identifier = messages(system_of(content))[first - 1][2] + own
    row = next(row for row in costs["frames"] if row["identifier"] == identifier)
    sync = [length for _, length in syncs_of(frames)]
    latencies = [
        time % 2000 - sync[time // 2000] for time, heard, _, _ in frames if heard == identifier
    ]
    assert max(latencies) == round(row["latency"] * 1e6)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_latency_is_that_in_the_worst_graph(encoding):
    """Link 3 to 4 comes first in one graph and third in another, in whatever order they stand."""
    content = still("link", encoding, [0] * 4, 2000)
    graphs = [{"edges": [[1, 2], [3, 4]]}, {"edges": [[3, 4]]}]
    content["topology"] = {"graphs": graphs[:1]}
    alone = bus_cost(system_of(content))["frames"]
    for order in (graphs, graphs[::-1]):
        content["topology"] = {"graphs": order, "transition": [[0.5, 0.5], [0.5, 0.5]]}
        assert bus_cost(system_of(content))["frames"] == alone


# --- shortest step, largest group ---


@pytest.mark.parametrize(("mode", "encoding"), KINDS)
def test_shortest_step(tmp_path, mode, encoding):
    """It holds the worst contents without delaying SYNC, and one bit time less does not."""
    bits = worst_bits(mode, encoding, 8)
    costs = bus_cost(system_of(still(mode, encoding, bits, 2000)))
    shortest = round(costs["shortest_period_in_step"] * 1e6)

    result, frames = simulate(tmp_path, still(mode, encoding, bits, shortest))
    assert result["late_frames"] == 0
    assert set(sync_delays(frames, shortest)) == {0}

    result, frames = simulate(tmp_path, still(mode, encoding, bits, shortest - 1))
    assert max(sync_delays(frames, shortest - 1)) >= 1
    if encoding == "identifier":
        # But for SYNC the same contents in every step: where the shortest SYNC is too long as well,
        # the delay grows until the last frame is too late.
        less = shortest - len(SYNC_BITS)
        result, _ = simulate(tmp_path, still(mode, encoding, bits, less))
        assert result["late_frames"] > 0

    # 5 % less is too short for what is longest in one step of 128 as well.
    result, _ = simulate(tmp_path, still(mode, encoding, bits, math.floor(0.95 * shortest)))
    assert result["late_frames"] > 0


@pytest.mark.parametrize(("mode", "encoding"), KINDS)
def test_guaranteed_step_holds_whatever_is_sent(tmp_path, mode, encoding):
    content = still(mode, encoding, [0] * 8, 2000)
    content["initial"]["states"] = [[0]] * 8
    costs = bus_cost(system_of(content))
    content["period"] = costs["shortest_period"]
    shorter = bus_cost(system_of(content))
    assert shorter["fits"]
    assert shorter["load_guaranteed"] == pytest.approx(1)
    if mode == "broadcast":
        assert shorter["agents_largest"] == 8
    result, frames = simulate(tmp_path, content, steps=2000)
    assert result["late_frames"] == 0
    assert set(sync_delays(frames, round(content["period"] * 1e6))) == {0}
    for less in (1e-6, 0.5e-6):
        content["period"] = costs["shortest_period"] - less
        shorter = bus_cost(system_of(content))
        assert not shorter["fits"]
        if mode == "broadcast":
            assert shorter["agents_largest"] == 7


def test_shortest_step_is_not_lost_in_rounding():
    """Seconds times bit rate must give back the bits that they were made of."""
    inexact = 0
    for bitrate in (33_333.3, 83_333, 125_000, 500_000, 1_000_000):
        for agents in range(2, 40):
            content = still("broadcast", "identifier", [0] * agents, 1e6)
            content["bus"]["bitrate"] = bitrate
            content["period"] = bus_cost(system_of(content))["shortest_period"]
            bits = content["period"] * bitrate
            inexact += bits < round(bits)
            assert bus_cost(system_of(content))["fits"]
    assert inexact > 0


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("period_bits", [700, 1003, 1250])
def test_largest_group(tmp_path, encoding, period_bits):
    costs = bus_cost(system_of(still("broadcast", encoding, [0] * 4, period_bits)))
    largest = costs["agents_largest"]
    assert largest == costs["agents_by_period"] < costs["agents_by_identifier"]

    def edges(agents):
        return [[k, k + 1] for k in range(1, agents)]

    content = still("broadcast", encoding, worst_bits("broadcast", encoding, largest), period_bits)
    content["topology"]["graphs"][0]["edges"] = edges(largest)
    assert bus_cost(system_of(content))["fits"]
    result, frames = simulate(tmp_path, content)
    assert result["late_frames"] == 0
    assert set(sync_delays(frames, period_bits)) == {0}

    more = largest + 1
    content = still("broadcast", encoding, worst_bits("broadcast", encoding, more), period_bits)
    content["topology"]["graphs"][0]["edges"] = edges(more)
    costs = bus_cost(system_of(content))
    assert not costs["fits"]
    assert costs["shortest_period"] * 1e6 > period_bits + 0.5
    if encoding == "identifier":
        result, frames = simulate(tmp_path, content)
        assert result["late_frames"] > 0


def test_largest_group_of_a_ring():
    """In link mode an estimate, on the safe side: larger numbers need fewer stuff bits."""

    def ring(agents):
        edges = [[k, k % agents + 1] for k in range(1, agents + 1)]
        return bus_cost(system_of(still("link", "payload", [0] * agents, 200_000, edges)))

    largest = ring(6)["agents_largest"]
    assert not ring(math.ceil(1.06 * largest))["fits"]
    assert ring(largest)["fits"]


@pytest.mark.parametrize(
    ("mode", "encoding", "bus", "limit"),
    [
        ("broadcast", "payload", {}, 1775),
        ("broadcast", "identifier", {}, 503),
        ("broadcast", "payload", {"base": 0x7E0}, 15),
        ("broadcast", "identifier", {"base": 0x7E0}, 7),
        ("link", "payload", {}, 8191),
        ("link", "identifier", {}, 8191),
    ],
)
def test_identifiers_limit_the_group(mode, encoding, bus, limit):
    content = still(mode, encoding, [0] * 4, 1e6, **bus)
    costs = bus_cost(system_of(content))
    assert costs["agents_by_identifier"] == limit
    assert costs["agents_largest"] == min(limit, costs["agents_by_period"])
    assert costs["fits"]
    if mode == "broadcast":
        content = still(mode, encoding, [0] * (limit + 1), 1e6, **bus)
        costs = bus_cost(system_of(content))
        assert not costs["fits"]
        senders = {row["sender"] for row in costs["frames"]}
        assert max(senders) == limit
        assert max(row["identifier"] for row in costs["frames"]) in (0x7EF, 0x7EE)
        assert f"FAILS: {limit + 1} agents" in "\n".join(report_lines(costs))


def test_links_beyond_the_identifiers():
    content = still("link", "payload", [0] * 8192, 1e6, [[1, 2], [8190, 8191], [8191, 8192]])
    costs = bus_cost(system_of(content))
    assert not costs["fits"]
    assert [(row["sender"], row["receiver"]) for row in costs["frames"]] == [
        (0, 0), (1, 2), (2, 1), (8190, 8191), (8191, 8190),
    ]  # fmt: skip


# --- report ---


def test_report_of_the_aircraft():
    costs = bus_cost(system_of(aircraft("aircraft-fixed", "link", "payload")))
    assert json.loads(json.dumps(costs)) == costs  # stands in a file as it is
    text = "\n".join(report_lines(costs))
    assert "CAN at 500 kbit/s, link mode, payload encoding, a step every 500 ms" in text
    assert "guaranteed 0.69 %, with clocks in step 0.682 %, mean 0.669 %" in text
    assert "SYNC 57..59" in text
    assert "3.448 ms" in text
    assert "1050 agents" in text
    assert "FAILS" not in text
    assert re.search(r"0x10004004 +1 to 2 +80\.\.83 +80\.7 +0\.452 ms +0\.160 ms", text)
    assert "... 5 more" in text
    assert "7 to 6" in text
    assert max(map(len, text.splitlines())) <= 100


def test_report_of_a_period_too_short():
    content = aircraft("aircraft-fixed", "link", "payload")
    content["period"] = 0.003
    costs = bus_cost(system_of(content))
    assert not costs["fits"]
    last = costs["frames"][-1]
    assert last["response"] is None
    assert costs["frames"][1]["response"] is not None
    text = "\n".join(report_lines(costs))
    assert "FAILS: the worst case does not fit into the period" in text
    assert "may be late" in text.splitlines()[-1]


def test_a_group_without_links():
    content = still("link", "payload", [0, 0], 1000)
    system = system_of(content)
    system.graphs = [[]]
    costs = bus_cost(system)
    assert costs["load_guaranteed"] == costs["load_in_step"] == pytest.approx(SYNC_BITS[-1] / 1000)
    assert costs["load_mean"] == pytest.approx(SYNC_MEAN / 1000)
    assert [row["identifier"] for row in costs["frames"]] == [SYNC]
    assert report_lines(costs)
