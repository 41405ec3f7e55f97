"""tools/onebit_design/dbc.py: cantools decodes with it what onebit-sim sent, frame by frame."""

import re
import sys
from pathlib import Path

import can
import cantools
import pytest
import yaml
from simulator import ROOT, SCENARIOS, run
from test_bus_cost import system_of

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tools"))

from onebit_design import bus_cost
from onebit_design.dbc import dbc_text

STEPS = 300  # the clock modulo 128 returns twice
NAMES = ["aircraft-fixed", "aircraft-markov"]
MODES = ["link", "broadcast"]


def scenario(name, mode, encoding="payload", **more):
    content = yaml.safe_load((SCENARIOS / f"{name}.yaml").read_text())
    content["channel"]["mode"] = mode
    content["bus"] = {"model": "can", "bitrate": 500000, "encoding": encoding}
    return {**content, **more}


def database(content):
    return cantools.database.load_string(dbc_text(system_of(content)), "dbc")


def test_constants_are_those_of_the_library():
    text = "".join(
        (ROOT / f"lib/{name}.h").read_text() for name in ("onebit_frame", "onebit_codec")
    )
    found = dict(re.findall(r"#define (\w+) (0[xX][0-9a-fA-F]+|\d+)u", text))
    of_library = {
        "ONEBIT_PAYLOAD_BASE": bus_cost.PAYLOAD_BASE,
        "ONEBIT_IDENTIFIER_BASE": bus_cost.IDENTIFIER_BASE,
        "ONEBIT_LINK_BASE": bus_cost.LINK_BASE,
        "ONEBIT_SYNC_IDENTIFIER": bus_cost.SYNC_IDENTIFIER,
        "ONEBIT_STEP_MODULUS": bus_cost.STEP_MODULUS,
        "ONEBIT_LINK_SENDER_SHIFT": bus_cost.SENDER_SHIFT,
        "ONEBIT_LINK_RECEIVER_SHIFT": bus_cost.RECEIVER_SHIFT,
        "ONEBIT_IDENTIFIER_LAST": bus_cost.IDENTIFIER_LAST,
        "ONEBIT_LINK_AGENT_LAST": bus_cost.LINK_AGENT_LAST,
    }
    assert {name: int(found[name], 0) for name in of_library} == of_library


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", NAMES)
def test_decodes_a_run(tmp_path, name, mode):
    content = scenario(name, mode)
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump(content))
    run(path, steps=STEPS, log=tmp_path / "bus.log")
    known = database(content)

    t = content["gains"]["t0"]
    heard = set()
    counts = {"frames": 0, "ones": 0}
    with can.CanutilsLogReader(tmp_path / "bus.log") as reader:
        for frame in reader:
            message = known.get_message_by_frame_id(frame.arbitration_id)  # KeyError if unknown
            assert message.is_extended_frame == frame.is_extended_id
            assert message.length == len(frame.data)
            decoded = known.decode_message(frame.arbitration_id, frame.data)
            heard.add(message.name)
            if message.name == "SYNC":
                t += 1
                assert decoded == {"counter": t % 128 or 128}
                continue
            assert decoded == {"bit": frame.data[0] & 1, "step": t % 128}
            counts["frames"] += 1
            counts["ones"] += decoded["bit"]
            # Who sent it, from the identifier alone.
            if mode == "link":
                sender = frame.arbitration_id >> 14 & 0x1FFF
                receiver = frame.arbitration_id >> 1 & 0x1FFF
                assert message.name == f"message_{sender}_to_{receiver}"
                assert message.receivers == {f"agent_{receiver}"}
            else:
                sender = frame.arbitration_id - 0x100
                assert message.name == f"message_{sender}"
            assert message.senders == [f"agent_{sender}"]
    assert t == content["gains"]["t0"] + STEPS
    # None that nobody sends; the simulator's runs end without a stop.
    assert heard | {"network_management"} == {message.name for message in known.messages}
    assert 0 < counts["ones"] < counts["frames"]


@pytest.mark.parametrize("mode", MODES)
def test_says_who_and_how_often(mode):
    known = database(scenario("aircraft-fixed", mode))
    assert known.version == "aircraft-fixed"
    assert [node.name for node in known.nodes] == ["master"] + [f"agent_{k}" for k in range(1, 8)]
    assert len(known.messages) == 2 + (20 if mode == "link" else 7)
    management = known.get_message_by_name("network_management")
    assert (management.frame_id, management.length) == (0x000, 2)
    assert management.senders == ["master"]
    assert known.decode_message(0x000, b"\x02\x00") == {"command": 2, "node": 0}
    for message in known.messages:
        if message is management:
            continue
        assert message.cycle_time == 500
        assert "500 ms" in message.comment
        assert all(signal.comment for signal in message.signals)
        layout = {signal.name: (signal.start, signal.length) for signal in message.signals}
        of_message = {"bit": (0, 1), "step": (1, 7)}
        assert layout == ({"counter": (0, 8)} if message.name == "SYNC" else of_message)
    sync = known.get_message_by_name("SYNC")
    assert (sync.frame_id, sync.length, sync.senders) == (0x080, 1, ["master"])
    (counter,) = sync.signals
    assert (counter.minimum, counter.maximum) == (1, 128)
    assert counter.receivers == [f"agent_{k}" for k in range(1, 8)]
    if mode == "broadcast":
        # Agent 1 of the ring with chords hears 2 and 7, and 5 across.
        receivers = known.get_message_by_name("message_1").receivers
        assert receivers == {"agent_2", "agent_5", "agent_7"}


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", NAMES)
def test_text_is_stable(name, mode):
    content = scenario(name, mode)
    text = dbc_text(system_of(content))
    assert text == dbc_text(system_of(content))
    assert "\r" not in text
    assert text.isascii()
    # What cantools reads it writes again.
    assert database(content).as_dbc_string().replace("\r\n", "\n") == text


def test_base_of_the_scenario():
    content = scenario("aircraft-fixed", "broadcast")
    content["bus"]["base"] = 0x200
    assert database(content).get_message_by_name("message_7").frame_id == 0x207


def test_nothing_to_describe_in_identifier_form():
    for mode in MODES:
        assert dbc_text(system_of(scenario("aircraft-fixed", mode, "identifier"))) is None


@pytest.mark.parametrize(
    ("period", "cycle"),
    [(0.5, 500), (0.001, 1), (65.535, 65535), (0.0005, None), (0.0015, None), (100, None)],
)
def test_cycle_time_only_where_it_is_exact(period, cycle):
    known = database(scenario("two-agents", "link", period=period))
    for message in known.messages:
        if message.name == "network_management":
            assert message.cycle_time is None
            continue
        assert message.cycle_time == cycle
        assert f"every {1000 * period:.10g} ms" in message.comment


def test_any_name():
    known = database({**scenario("two-agents", "link"), "name": 'a "b" \\ ü\n'})
    assert known.version == "a ?b? ? ??"


def test_agents_beyond_the_identifiers():
    content = scenario("two-agents", "broadcast")
    content["bus"]["base"] = 0x7EE  # room for one
    known = database(content)
    names = [message.name for message in known.messages]
    assert names == ["SYNC", "network_management", "message_1"]
    assert known.get_message_by_name("message_1").receivers == set()
