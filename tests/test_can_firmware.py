"""The firmware of ports/can-controller/ as an integrator builds it.

It compiles for Cortex-M without a warning and does on a Cortex-M0, a Cortex-M4F and the host what
onebit-sim did; its queue is interrupted at every instruction, and shared by two threads.
"""

import re
import shutil
from pathlib import Path

import pytest
import yaml
from programs import need, run
from simulator import BUILD, ROOT, call, rows
from simulator import run as simulate

SOURCES = [*sorted((ROOT / "ports/can-controller").glob("*.c")), ROOT / "ports/step_loop.c"]
LIBRARY = [ROOT / "ports/alignment.c", *(ROOT / "lib").glob("*.c"), ROOT / "sim/integer_plant.c"]
TESTS = ROOT / "tests/can_controller"
STEPS = 300
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion"]
STRICT += ["-Wdouble-promotion", "-Wcast-align", "-Wshadow", "-Werror"]
# What chooses the queue in tests/can_controller/*.c: frame_queue.h or byte_queue.h.
QUEUES = {"frames": [], "bytes": ["-DBYTES"]}
INCLUDE = [f"-I{ROOT / folder}" for folder in ("lib", "ports", "ports/can-controller", "sim")]

# picolibc's start-up with text and exit status by semihosting; where memory lies on the board.
PICOLIBC = ["-specs=picolibc.specs", "--crt0=hosted", "--oslib=semihost"]


def memory(flash, ram):
    places = {"flash": 0, "flash_size": flash, "ram": 0x20000000, "ram_size": ram}
    return [f"-Wl,--defsym=__{name}={value}" for name, value in places.items()]


M4F = ["-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-mthumb"]
TARGETS = {
    "cortex-m0": (
        ["arm-none-eabi-gcc", "-mcpu=cortex-m0", "-mthumb", *PICOLIBC, *memory(0x40000, 0x4000)],
        "microbit",
    ),
    "cortex-m4f": (
        ["arm-none-eabi-gcc", *M4F, *PICOLIBC, *memory(0x400000, 0x400000)],
        "mps2-an386",
    ),
    "host": (["gcc", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"], None),
}


def compiler(target):
    command, board = TARGETS[target]
    if board is not None:
        need("arm-none-eabi-gcc", "gcc-arm-none-eabi")
        if not Path("/usr/lib/picolibc/arm-none-eabi").is_dir():
            need("picolibc", "picolibc-arm-none-eabi")
    return [*command, *STRICT, *INCLUDE]


def execute(target, image):
    board = TARGETS[target][1]
    if board is None:
        return run(image, timeout=60)
    # Each instruction takes 1.024 us, so that runs are the same every time.
    emulator = [need("qemu-system-arm"), "-M", board, "-icount", "shift=10", "-display", "none"]
    emulator += ["-serial", "none", "-monitor", "none", "-chardev", "stdio,id=console"]
    emulator += ["-semihosting-config", "enable=on,target=native,chardev=console", "-kernel"]
    return run(*emulator, image, timeout=60)


def pumps(folder, encoding, period):
    """Six pumps, of which each begins with an idea of the others."""
    examples = ROOT / "tools/onebit_design/examples"
    shutil.copy(examples / "pumps.edges", folder)
    content = yaml.safe_load((examples / "pumps.yaml").read_text())
    content["initial"]["estimates"] = 0.25
    content["period"] = period
    content["bus"]["encoding"] = encoding
    return content


def aircraft(_, mode):
    """Seven aircraft of four states."""
    content = yaml.safe_load((ROOT / "sim/scenarios/aircraft-fixed.yaml").read_text())
    content["channel"]["mode"] = mode
    return content


SYSTEMS = {
    "payload": (pumps, "payload", 0.1),
    "identifier": (pumps, "identifier", 0.1),
    "10 ms": (pumps, "payload", 0.01),
    "link": (aircraft, "link"),
    "broadcast": (aircraft, "broadcast"),
}


def design(name, folder):
    """What onebit-design writes for firmware of a system with integer plants, and a run's log."""
    make, *choice = SYSTEMS[name]
    content = make(folder, *choice)
    content["plant"]["arithmetic"] = "q31"
    content["bus"]["model"] = "ideal"
    (folder / "system.yaml").write_text(yaml.safe_dump(content))
    run(BUILD / "bin/onebit-design", folder / "system.yaml", "--out", folder, "--runs", "0")
    simulate(folder / "scenario.yaml", arith="q31", steps=STEPS, seed=1, log=folder / "bus.log")
    return folder


@pytest.fixture(scope="module", params=["payload", "identifier", "10 ms", "link"])
def system(request, tmp_path_factory):
    return design(request.param, tmp_path_factory.mktemp("system"))


def constant(system, name):
    text = (system / "onebit_config.h").read_text()
    return int(re.search(rf"#define {name} (\d+)", text)[1])


def sender_of(identifier):
    """0x10000000 + (sender << 14) + .., 0x100 + sender, or 0x400 + 2 sender + bit."""
    if identifier >= 0x10000000:
        return (identifier - 0x10000000) >> 14
    return identifier - 0x100 if identifier < 0x400 else (identifier - 0x400) // 2


def write_log(system, agent, folder):
    """bus_log.h: of each step the own frames and the others', as they stand in the log."""
    scenario = yaml.safe_load((system / "scenario.yaml").read_text())
    step_frames = []
    for line in (system / "bus.log").read_text().splitlines():
        identifier, _, data = line.split()[2].partition("#")
        if identifier == "080":
            step_frames.append([])
        else:
            text = f"{{0x{identifier}u, {len(data) // 2}u, 0x{data or 0}u}}"
            step_frames[-1].append((sender_of(int(identifier, 16)), text))
    assert len(step_frames) == STEPS
    lines = []
    for frames in step_frames:
        assert {sender for sender, _ in frames} == set(
            range(1, constant(system, "ONEBIT_CONFIG_AGENTS") + 1)
        )
        own = [text for sender, text in frames if sender == agent]
        others = [text for sender, text in frames if sender != agent]
        lines.append(f"    {{{{{', '.join(own)}}}, {{{', '.join(others)}}}}},")
    (folder / "bus_log.h").write_text(f"""
#include <stdint.h>
#define BUS_LOG_AGENT {agent}u
#define BUS_LOG_FIRST {scenario["gains"]["t0"] + 1}u
#define BUS_LOG_PERIOD {round(scenario["period"] * 1e6)}u
#define BUS_LOG_STEPS {STEPS}u
#define BUS_LOG_OWN {len(own)}u
#define BUS_LOG_OTHERS {len(others)}u
struct logged {{
    uint32_t identifier;
    uint8_t length;
    uint8_t data;
}};
static const struct logged_step {{
    struct logged own[BUS_LOG_OWN];
    struct logged others[BUS_LOG_OTHERS];
}} bus_log[BUS_LOG_STEPS] = {{
{chr(10).join(lines)}
}};
""")


STATE_BITS = "ONEBIT_CONFIG_STATE_FRACTION_BITS"
CONTROL_BITS = "ONEBIT_CONFIG_CONTROL_FRACTION_BITS"
NOISE_BITS = 27  # the library's Q4.27


def simulated(system, agent):
    """Of each step states, input and estimates as integers, from the simulator's replay."""
    scenario = system / "scenario.yaml"
    done = call("replay", scenario, system / "bus.log", "--agent", agent, "--arith", "q31")
    assert done.returncode == 0, done.stderr
    (system / "replay.csv").write_text(done.stdout)
    state = 2 ** constant(system, STATE_BITS)
    control = 2 ** constant(system, CONTROL_BITS)
    noise = 2**NOISE_BITS / yaml.safe_load(scenario.read_text())["noise"]["sigma"]
    states = range(1, constant(system, "ONEBIT_CONFIG_STATES") + 1)
    return [
        (
            [float(row[f"x{k}"]) * state for k in states],
            float(row["u"]) * control,
            [float(row[name]) * noise for name in row if name.startswith("zhat_")],
        )
        for row in rows(system / "replay.csv")
    ]


@pytest.mark.parametrize("agent", [1, 3])
@pytest.mark.parametrize("target", list(TARGETS))
def test_firmware_does_what_the_simulator_did(system, target, agent, tmp_path):
    write_log(system, agent, tmp_path)
    command = [*compiler(target), "-Os", f"-I{system}", f"-I{tmp_path}", *SOURCES, *LIBRARY]
    run(*command, TESTS / "board.c", "-o", tmp_path / "firmware")
    first, *lines, last = execute(target, tmp_path / "firmware").splitlines()
    assert last == "own frames wrong 0, overruns 0"
    got = [[int(word) for word in line.split()] for line in lines[:STEPS]]
    assert got == [[*x, u] for x, u, _ in simulated(system, agent)]
    assert len({u for *_, u in got}) > STEPS / 2  # not a row of zeros
    # On hold at the start, when SYNC stays away and when it is stopped; in between a step each.
    assert [line == "hold" for line in lines[STEPS:]] == [True, False, True, False]
    assert first == "hold"


# Of tests/can_controller/group.c: steps before anybody restarts, the last event, all steps.
CALM, LAST_EVENT, GROUP_STEPS = 300, 360, 1000
GATHERED = 460


def run_group(system, target, image, sync_counts):
    options = ["-O2", "-DSYNC_COUNTS"] if sync_counts else ["-O2"]
    sources = [source for source in SOURCES if source.name != "main.c"]
    command = [*compiler(target), *options, f"-I{system}", *sources, *LIBRARY]
    run(*command, TESTS / "group.c", "-o", image)
    return execute(target, image)


@pytest.mark.parametrize("sync_counts", [True, False])
@pytest.mark.parametrize("system", ["link", "broadcast"], indirect=True)
def test_group_starts_restarts_and_agrees(system, sync_counts, tmp_path):
    agents = range(constant(system, "ONEBIT_CONFIG_AGENTS"))
    said = run_group(system, "host", tmp_path / "group", sync_counts).splitlines()
    numbers = [[int(word) for word in line.split()] for line in said[: -len(agents)]]
    calm = numbers[: CALM * len(agents)]
    later = numbers[len(calm) : -len(agents)]
    last = numbers[-len(agents) :]
    assert len(later) == GROUP_STEPS - CALM

    # Each state, input and estimate, so each bit, is the simulator's.
    for agent in agents:
        wanted = [[*x, u, *estimates] for x, u, estimates in simulated(system, agent + 1)]
        assert calm[agent :: len(agents)] == wanted, agent + 1
    neighbours = [
        len(calm[agent]) - constant(system, "ONEBIT_CONFIG_STATES") - 1 for agent in agents
    ]
    assert sum(neighbours) == 20

    # The clocks gather, and then each takes all that its neighbours say, in every step.
    apart = {CALM + k for k, line in enumerate(later) if len({t % 128 for t in line[::2]}) != 1}
    deaf = {CALM + k for k, line in enumerate(later) if line[1::2] != neighbours}
    if sync_counts:  # at once, but for who is stopped or has just restarted
        assert apart == {*range(331, 350), LAST_EVENT}
    assert max(apart) < GATHERED
    assert max(deaf) < GATHERED
    assert {*range(331, 350), LAST_EVENT} <= deaf

    # They agree: the altitudes, from 1 to 5 in the beginning, lie together.
    unit = 2 ** constant(system, STATE_BITS)
    altitudes = [line[2] / unit for line in last]
    assert max(altitudes) - min(altitudes) < 1
    assert 1 < min(altitudes) < max(altitudes) < 5

    # 2 and 5 restarted before step 300, 1, 3, 4 and 6 in step 360, which they gave up; 7 was
    # stopped for steps 330 to 349. Nobody else was ever on hold.
    steps = {1: 639, 2: 700, 3: 639, 4: 639, 5: 700, 6: 639, 7: 980}
    for agent in agents:
        held = 0 if agent + 1 in (2, 5) else 1
        wanted = rf"steps {steps[agent + 1]} held {held} aligned [1-9]\d* late 0"
        assert re.fullmatch(wanted, said[agent - len(agents)])


@pytest.mark.parametrize("system", ["link", "broadcast"], indirect=True)
def test_group_does_the_same_on_a_cortex_m0(system, tmp_path):
    wanted = run_group(system, "host", tmp_path / "host", sync_counts=True)
    assert run_group(system, "cortex-m0", tmp_path / "image", sync_counts=True) == wanted


@pytest.mark.parametrize("arithmetic", ["Q31", "F32"])
@pytest.mark.parametrize("level", ["-O0", "-O2", "-Os"])
@pytest.mark.parametrize("target", ["cortex-m0", "cortex-m4f"])
@pytest.mark.parametrize("system", ["payload", "link"], indirect=True)
def test_compiles_without_a_warning(system, target, level, arithmetic, tmp_path):
    for source in SOURCES:
        options = [level, f"-DONEBIT_ARITHMETIC=ONEBIT_{arithmetic}", f"-I{system}"]
        run(*compiler(target), *options, "-c", source, "-o", tmp_path / "object.o")


@pytest.mark.parametrize("level", ["-O0", "-O2", "-Os"])
@pytest.mark.parametrize("queue", QUEUES)
def test_queue_with_an_interrupt_at_every_instruction(queue, level, tmp_path):
    image = tmp_path / "points"
    command = [*compiler("cortex-m0"), level, *QUEUES[queue]]
    run(*command, TESTS / "interrupt_points.c", "-o", image)
    *seen, last = execute("cortex-m0", image).split("\n")[:-1]
    assert re.fullmatch(r"runs \d{3,}, wrong 0", last)
    # The interrupt came before every instruction of the reader; a nop may be there to align.
    text = run("arm-none-eabi-objdump", "-d", "-j", "reader", image)
    code = re.findall(r"^ +([0-9a-f]+):\t[0-9a-f ]+\t(\S+)", text, re.M)
    instructions = {address for address, name in code if name not in (".word", "nop")}
    assert len(instructions) > 20
    assert not instructions - set(seen)


@pytest.mark.parametrize("queue", QUEUES)
def test_queue_between_threads(queue, tmp_path):
    program = tmp_path / "threads"
    command = ["gcc", *STRICT, *INCLUDE, *QUEUES[queue], "-O2", "-g", "-fsanitize=thread"]
    run(*command, "-pthread", TESTS / "queue_threads.c", "-o", program)
    assert run(program, timeout=60) == "entries 100000, wrong 0\n"
