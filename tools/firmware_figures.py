#!/usr/bin/env python3
"""Measure the library on each firmware platform and write the tables of ports/README.md.

usage: tools/firmware_figures.py            measures and writes the tables
       tools/firmware_figures.py --print    measures and prints them

Builds the images `figures` of ports/firmware for each toolchain preset, under build/figures/, runs
them on the emulator, and adds what needs no run: bytes of the library's objects at -Os and -O2 (but
for the names of the codes), what the compiler's own routines add, the worst-case stack over the
call graph, and what of it the README's example links. All of it is the same from run to run with
the same compilers, whose versions stand with the tables.

The stack: a function's own frame is what the compiler says (-fstack-usage), that of a compiler's
routine what its pushes and its change of the stack pointer add to; who calls whom is read from the
disassembly of the library linked as a whole, in which nothing is called by pointer and nothing
calls itself.
"""

import bisect
import json
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "ports/README.md"
BEGIN = "<!-- figures: written by tools/firmware_figures.py -->\n"
END = "<!-- end of figures -->\n"

PRESETS = {
    "cortex-m0": "Cortex-M0",
    "cortex-m3": "Cortex-M3",
    "cortex-m4f": "Cortex-M4F",
    "rv32imac": "RV32IMAC",
    "avr5": "ATmega328P",
}
OPERATIONS = ("update", "cdf", "encode", "control", "step")
ARITHMETICS = ("q31", "f32", "f64")
LEVELS = ("-Os", "-O2")
IMAGES = ("figures", "figures-floating")
# The README's two options for less flash, as the pump takes them.
SMALL = (
    "-DONEBIT_UNCHECKED",
    "-DONEBIT_ONLY_MODE=ONEBIT_MODE_BROADCAST",
    "-DONEBIT_ONLY_ENCODING=ONEBIT_ENCODING_PAYLOAD",
)
TODAY = {"float": "float, `erfcf`", "double": "double, `erfc`"}
TODAY_AVR = {"float": "float, polynomial and `exp`"}


class FiguresError(Exception):
    """What stopped the measurement, in one line."""


@dataclass
class Size:
    """The library in one arithmetic, at one level of optimisation."""

    flash: int  # code and constants
    support: int  # of the compiler's and C library's routines that it calls
    routines: set[str]  # their names
    data: int
    bss: int
    stack: int  # the deepest of the public functions, with what it calls


@dataclass
class Pump:
    """What lib/example/pump.c links in q31, at -Os."""

    flash: int  # of lib/
    table: int  # of it the table of the CDF
    support: int  # of the compiler's and C library's routines


@dataclass
class Platform:
    counts: dict[tuple[str, str], tuple[str, int]] = field(default_factory=dict)  # mean, worst
    memory: dict[str, int] = field(default_factory=dict)  # of an agent with three neighbours
    sizes: dict[tuple[str, str], Size] = field(default_factory=dict)
    pumps: dict[tuple[str, ...], Pump] = field(default_factory=dict)  # by the options for less


def run(*command: object, folder: Path = ROOT) -> str:
    words = [str(word) for word in command]
    try:
        done = subprocess.run(words, capture_output=True, text=True, cwd=folder)
    except FileNotFoundError:
        raise FiguresError(f"{words[0]} is not installed") from None
    if done.returncode != 0:
        raise FiguresError(f"{shlex.join(words)}: {(done.stdout + done.stderr).strip()}")
    return done.stdout


def build_folder(preset: str) -> Path:
    return ROOT / "build/figures" / preset


def compile_commands(preset: str) -> list[dict]:
    return json.loads((build_folder(preset) / "compile_commands.json").read_text())


def compiler(preset: str) -> str:
    return shlex.split(compile_commands(preset)[0]["command"])[0]


def tool(preset: str, name: str) -> str:
    """A program that stands beside the compiler: arm-none-eabi-gcc, arm-none-eabi-size."""
    return compiler(preset).removesuffix("gcc") + name


@cache
def build(preset: str) -> None:
    folder = build_folder(preset)
    run("cmake", "--preset", preset, "-B", folder)
    run("cmake", "--build", folder, "--target", *IMAGES, "--parallel", "2")


def versions() -> str:
    """The compilers, each once, as GCC itself says it."""
    found = {}
    for preset in PRESETS:
        build(preset)
        program = compiler(preset)
        found[Path(program).name] = run(program, "-dumpfullversion", "-dumpversion").strip()
    return ", ".join(f"{name} {version}" for name, version in found.items())


def read_counts(platform: Platform, text: str) -> None:
    for line in text.splitlines():
        if match := re.fullmatch(r"(\w+) (\w+) mean ([\d.]+) worst (\d+)", line):
            platform.counts[match[1], match[2]] = (match[3], int(match[4]))
        elif match := re.fullmatch(r"(\w+) memory (\d+)", line):
            platform.memory[match[1]] = int(match[2])
        else:
            raise FiguresError(f"an image says what is no figure: {line}")


def count(preset: str, platform: Platform) -> None:
    """Runs the image as the platform's CTest would."""
    listed = run("ctest", "--test-dir", build_folder(preset), "--show-only=json-v1")
    commands = {test["name"]: test["command"] for test in json.loads(listed)["tests"]}
    for image in IMAGES:
        read_counts(platform, run(*commands[image]))


def defined(preset: str, path: Path, kinds: str) -> set[str]:
    """The symbols of some kinds, by nm's letters, that an object defines."""
    lines = run(tool(preset, "nm"), "-P", "--defined-only", path).splitlines()
    return {name for name, kind, *_ in map(str.split, lines) if kind in kinds}


def library_commands(preset: str, arithmetic: str, level: str) -> dict[Path, list[str]]:
    """How the preset compiles the library's sources, but for the level; without -o."""
    commands = {}
    for entry in compile_commands(preset):
        source = Path(entry["file"])
        words = shlex.split(entry["command"])
        others = {f"-DONEBIT_ARITHMETIC=ONEBIT_{name.upper()}" for name in ARITHMETICS}
        others.remove(f"-DONEBIT_ARITHMETIC=ONEBIT_{arithmetic.upper()}")
        if source.parent != ROOT / "lib" or others & {*words}:
            continue
        words = words[: words.index("-o")]
        assert "-O2" in words
        commands[source] = [level if word == "-O2" else word for word in words]
    return commands


def link(preset: str, words: list[str], kept: set[str], objects: list[Path], image: Path) -> None:
    """What a set of functions needs, and of the routines what it calls; with a map."""
    flags = [word for word in words if word.startswith(("-m", "--specs"))]
    flags += ["-nostartfiles", f"-Wl,-Map={image}.map,-e,0,--gc-sections"]
    flags += ["-Wl,--defsym=pump_send=0"]  # the board's, of the README's example
    flags += [f"-Wl,-u,{name}" for name in sorted(kept)]
    run(compiler(preset), *flags, *objects, "-lm", "-o", image, folder=image.parent)


def compile_library(preset: str, arithmetic: str, level: str) -> tuple[Path, list[Path]]:
    """Its objects, linked as a whole."""
    folder = build_folder(preset) / "library" / f"{arithmetic}{level}"
    folder.mkdir(parents=True, exist_ok=True)
    objects = {}
    for source, words in library_commands(preset, arithmetic, level).items():
        objects[source.stem] = folder / f"{source.stem}.o"
        run(*words, "-fstack-usage", "-c", source, "-o", objects[source.stem], folder=folder)
    # Linked where they are needed: the names of the codes by who prints them, the CDF's table by
    # f32 and q31.
    del objects["onebit_status"]
    needed = run(tool(preset, "nm"), "-P", "-u", objects["onebit_agent"]).split()
    if not defined(preset, objects["onebit_cdf_table"], "RDT") & {*needed}:
        del objects["onebit_cdf_table"]
    paths = list(objects.values())
    image = folder / "library.elf"
    public = set().union(*(defined(preset, path, "T") for path in paths))
    link(preset, words, public, paths, image)
    return image, paths


def measure_pump(preset: str, options: tuple[str, ...]) -> Pump:
    """The README's firmware, with the options in its own sources and the library's."""
    folder = build_folder(preset) / "pump" / ("small" if options else "whole")
    folder.mkdir(parents=True, exist_ok=True)
    commands = library_commands(preset, "q31", "-Os")
    example = ROOT / "lib/example/pump.c"
    commands[example] = commands[ROOT / "lib/onebit_agent.c"]
    objects = []
    for source, words in commands.items():
        objects.append(folder / f"{source.stem}.o")
        run(*words, *options, "-c", source, "-o", objects[-1], folder=folder)
    image = folder / "pump.elf"
    verbs = defined(preset, objects[-1], "T")
    link(preset, words, verbs, objects, image)
    sizes = linked_sizes(image)
    return Pump(
        flash=sum(size for name, size in sizes.items() if name.startswith("onebit_")),
        table=sizes["onebit_cdf_table.o"],
        support=sum(size for name, size in sizes.items() if ".a(" in name),
    )


def section_sizes(preset: str, path: Path) -> dict[str, int]:
    """text (with the constants), data and bss of an object."""
    heading, numbers = run(tool(preset, "size"), path).splitlines()[:2]
    return dict(zip(heading.split()[:3], map(int, numbers.split()[:3]), strict=True))


def linked_sizes(image: Path) -> dict[str, int]:
    """Bytes of each object, or member of an archive, that the linker's map has in memory."""
    text = Path(f"{image}.map").read_text().split("Linker script and memory map", 1)[1]
    sizes: dict[str, int] = {}
    pattern = r"^ \.(?:text|rodata)\S*\s+0x[0-9a-f]+\s+0x([0-9a-f]+)\s+\S*?([^/\s]+)$"
    for match in re.finditer(pattern, text, re.MULTILINE):
        if size := int(match[1], 16):
            sizes[match[2]] = sizes.get(match[2], 0) + size
    return sizes


@dataclass
class Function:
    frame: int = 0
    calls: set[str] = field(default_factory=set)
    jumps: set[str] = field(default_factory=set)


CALL = re.compile(r"(?:blx?|jal|call|rcall)\s")
# A jump into another function is a call at the end, without a return address of its own.
JUMP = re.compile(
    r"(?:bx?(?:\.[nw])?|b[a-z]{2}(?:\.[nw])?|cbn?z|beqz|bnez|blez|bgez|bltz|bgtz|bltu|bgeu"
    r"|jr?|jmp|rjmp|br[a-z]{2})\s"
)
TARGET = re.compile(r"\b(?:0x)?([0-9a-f]+) <")


def instruction_frame(text: str) -> int:
    """Bytes by which an instruction of a routine moves the stack down."""
    if match := re.match(r"(?:push|stmdb\s+sp!,|vpush)\s*\{(.*)\}", text):
        return 4 * sum(
            int(span[2]) - int(span[1]) + 1 if (span := re.match(r"r(\d+)-r(\d+)", part)) else 1
            for part in match[1].replace(" ", "").split(",")
        )
    if re.match(r"push\s+r\d+", text):
        return 1
    if match := re.match(r"sub(?:\.w)?\s+sp,(?: sp,)?\s*#(\d+)", text):
        return int(match[1])
    if match := re.match(r"add(?:i|i16sp)?\s+sp,sp,-(\d+)", text):
        return int(match[1])
    return 0


def stack_usage(objects: list[Path]) -> dict[str, int]:
    """The frames of the library's functions."""
    frames: dict[str, int] = {}
    for path in objects:
        for line in path.with_suffix(".su").read_text().splitlines():
            where, frame, kind = line.split("\t")
            if kind != "static":
                raise FiguresError(f"{where}: its frame is {kind}")
            name = where.rsplit(":", 1)[1].split(".")[0]
            frames[name] = max(int(frame), frames.get(name, 0))
    return frames


def return_bytes(preset: str) -> int:
    """Of a return address: on the stack of an AVR, where frames count it, else in a register."""
    return 2 if preset == "avr5" else 0


def call_graph(preset: str, image: Path, objects: list[Path]) -> dict[str, Function]:
    """The functions of the linked library, with the compiler's routines."""
    functions: dict[str, Function] = {}
    starts: dict[int, str] = {}
    targets: list[tuple[set[str], int]] = []
    listing = run(tool(preset, "objdump"), "-d", "--no-show-raw-insn", image)
    for line in listing.splitlines():
        if match := re.fullmatch(r"([0-9a-f]+) <(.+)>:", line):
            starts[int(match[1], 16)] = match[2]
            current = functions[match[2]] = Function()
        elif match := re.match(r"\s*[0-9a-f]+:\t(.*)", line):
            text = match[1]
            current.frame += instruction_frame(text)
            if target := TARGET.search(text):
                if CALL.match(text):
                    targets.append((current.calls, int(target[1], 16)))
                elif JUMP.match(text):
                    targets.append((current.jumps, int(target[1], 16)))
    # By address: objdump may name a place after a constant that happens to have its value.
    ordered = sorted(starts)
    for names, address in targets:
        if address >= ordered[0]:
            names.add(starts[ordered[bisect.bisect_right(ordered, address) - 1]])
    for name, frame in stack_usage(objects).items():
        for symbol, function in functions.items():
            # The compiler may have made a function anew under its name and a suffix.
            if symbol.split(".")[0] == name:
                function.frame = frame - return_bytes(preset)
    for name, function in functions.items():
        function.jumps.discard(name)  # a loop
        if preset == "avr5":
            function.calls.discard(name)  # rcall .+0 makes room on the stack
    return functions


def deepest(functions: dict[str, Function], name: str, call_bytes: int, path: tuple = ()) -> int:
    """Bytes of stack under a function, its own frame among them."""
    function = functions[name]
    path = (*path, name)
    if function.calls & set(path):
        raise FiguresError(f"{name} is part of a recursion")
    below = [call_bytes + deepest(functions, called, call_bytes, path) for called in function.calls]
    # Jumps back to where they came from are loops of hand-written routines.
    below += [deepest(functions, called, call_bytes, path) for called in function.jumps - set(path)]
    return function.frame + max(below, default=0)


def measure_size(preset: str, arithmetic: str, level: str) -> Size:
    image, objects = compile_library(preset, arithmetic, level)
    sizes = [section_sizes(preset, path) for path in objects]
    own = set().union(*(defined(preset, path, "TtRr") for path in objects))
    functions = call_graph(preset, image, objects)
    call_bytes = return_bytes(preset)
    public = [name for name in functions if re.match(r"onebit_[a-z0-9_]+$", name)]
    return Size(
        flash=sum(size["text"] + size["data"] for size in sizes),
        support=sum(size for name, size in linked_sizes(image).items() if ".a(" in name),
        routines=defined(preset, image, "TtWw") - own,
        data=sum(size["data"] for size in sizes),
        bss=sum(size["bss"] for size in sizes),
        stack=call_bytes + max(deepest(functions, name, call_bytes) for name in public),
    )


def measure() -> dict[str, Platform]:
    platforms = {}
    for preset in PRESETS:
        build(preset)
        platform = platforms[preset] = Platform()
        count(preset, platform)
        platform.pumps = {options: measure_pump(preset, options) for options in ((), SMALL)}
        for arithmetic in platform.memory:
            for level in LEVELS:
                platform.sizes[arithmetic, level] = measure_size(preset, arithmetic, level)
    return platforms


def counts_table(platforms: dict[str, Platform]) -> list[str]:
    lines = [
        "| | | update | CDF | encode | control | step |",
        "|---|---|---|---|---|---|---|",
    ]
    for preset, platform in platforms.items():
        title = PRESETS[preset]
        today = TODAY_AVR if preset == "avr5" else TODAY
        for name in (*ARITHMETICS, *TODAY):
            cells = [
                f"{float(mean):,.1f}, {worst:,}"
                for operation in OPERATIONS
                for mean, worst in [platform.counts.get((name, operation), (None, None))]
                if mean is not None
            ]
            if cells:
                cells += [""] * (len(OPERATIONS) - len(cells))
                lines.append("| " + " | ".join([title, today.get(name, name), *cells]) + " |")
                title = ""
    return lines


def bytes_table(platforms: dict[str, Platform]) -> list[str]:
    lines = [
        "| | | flash -Os | flash -O2 | routines | agent's RAM | stack -Os | stack -O2 |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for preset, platform in platforms.items():
        title = PRESETS[preset]
        for name in ARITHMETICS:
            if name in platform.memory:
                small, fast = (platform.sizes[name, level] for level in LEVELS)
                numbers = (small.flash, fast.flash, small.support, platform.memory[name])
                numbers += (small.stack, fast.stack)
                cells = (f"{number:,}" for number in numbers)
                lines.append("| " + " | ".join([title, name, *cells]) + " |")
                title = ""
    return lines


def pumps_table(platforms: dict[str, Platform]) -> list[str]:
    lines = [
        "| | of `lib/` | table of the CDF | routines | of `lib/`, small | routines, small |",
        "|---|---|---|---|---|---|",
    ]
    for preset, platform in platforms.items():
        whole, small = (platform.pumps[options] for options in ((), SMALL))
        numbers = (whole.flash, whole.table, whole.support, small.flash, small.support)
        cells = (f"{number:,}" for number in numbers)
        lines.append("| " + " | ".join([PRESETS[preset], *cells]) + " |")
    return lines


def tables(platforms: dict[str, Platform]) -> str:
    return "\n".join(
        [
            f"With {versions()}.",
            "",
            "Instructions (ATmega328P: cycles) at -O2, mean and worst:",
            "",
            *counts_table(platforms),
            "",
            "Bytes:",
            "",
            *bytes_table(platforms),
            "",
            "Bytes of flash that the README's pump links in q31 at -Os; small is with",
            "`-DONEBIT_UNCHECKED` and its frame format fixed:",
            "",
            *pumps_table(platforms),
            "",
        ]
    )


def committed() -> str:
    """The tables of the README."""
    text = README.read_text(encoding="utf-8")
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise FiguresError(f"{README}: needs one line {BEGIN.strip()} and one {END.strip()}")
    return text.split(BEGIN)[1].split(END)[0]


def main() -> int:
    if sys.argv[1:] not in ([], ["--print"]):
        print(__doc__, file=sys.stderr)
        return 2
    try:
        before = "" if sys.argv[1:] else committed()
        text = tables(measure())
    except FiguresError as problem:
        print(f"firmware_figures: {problem}", file=sys.stderr)
        return 1
    if sys.argv[1:]:
        print(text, end="")
    else:
        whole = README.read_text(encoding="utf-8")
        README.write_text(whole.replace(BEGIN + before + END, BEGIN + text + END))
    return 0


if __name__ == "__main__":
    sys.exit(main())
