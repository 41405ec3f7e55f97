"""Proves the q31 library with Frama-C: Eva on verbs.c, WP on lemmas.c, for each kind of processor.

By hand, with Debian's frama-c-base, why3 and cvc4: python tests/proof/prove.py [DIRECTORY]; the
annotated copy of lib/ and Frama-C's output then lie there (build/proof). Prints what is not proved;
ends with 1 if that is anything. Takes about 80 s of one core for each processor.

Alarms are what C leaves undefined: signed overflow, shifts by less than 0 or by the width and
more, left shifts of negative numbers, division by zero, access out of bounds, pointers to
elsewhere, reads of what was never written, a bool that is neither 0 nor 1. Not alarms, as Frama-C
has it: what C defines, unsigned overflow and conversions to a narrower unsigned type; and what it
leaves to the compiler where all for two's complement do the same (lib/onebit_fixed.h), conversions
to a narrower signed type and right shifts of negative numbers.
"""

import csv
import os
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
LIBRARY = HERE.parent.parent / "lib"

# Of a processor matters the width of int, and the way that lib/onebit_processor.h goes for it.
# Frama-C's machines are PCs; these macros are what the processor's own compiler defines.
PROCESSORS = {
    # Products by halves; as compiled for little space, for what is done for speed, the sum of a
    # row's products by halves (onebit_products_by_halves), is not proved: test_fixed.c compares it.
    "cortex-m0": ("gcc_x86_32", ["-D__thumb__", "-D__OPTIMIZE_SIZE__"]),
    "rv32imac": ("gcc_x86_32", ["-D__riscv", "-D__riscv_mul"]),  # wide products
    "avr5": ("gcc_x86_16", ["-D__AVR__"]),  # int of 16 bits, shifts by one, halves by a union
}

# Annotations are written into a copy of lib/, each before the text that follows it here, which
# stands once in the file. For Eva: where it shall take cases one by one.
CASES = {
    "onebit_cdf.h": [("//@ split u < 0;", "uint32_t sign = (uint32_t)(u >> 31);")],
    "onebit_fixed.h": [
        ("//@ split places < 0;\n    //@ split places > 31;", "if ((unsigned)places > 31u) {"),
        ("//@ split places;", "int32_t limit = INT32_MAX >> -places;"),
        (
            "//@ split divisor < 0x80000000;\n    //@ split divisor < 0xC0000000;",
            "uint16_t x = onebit_half(divisor, ONEBIT_UPPER);",
        ),
    ],
    "onebit_check.c": [
        ("//@ split config->bound > 0;", "if (status == ONEBIT_OK) {"),
        (
            "//@ split config->estimator_gain.value < 0x80000000;\n"
            "    //@ split config->estimator_gain.fraction_bits < 15;\n"
            "    //@ split config->estimator_gain.fraction_bits > 62;",
            "if (!onebit_coefficient_valid(config->estimator_gain) ||",
        ),
    ],
    "onebit_processor.h": [
        ("//@ split places;", "uint8_t bits = (uint8_t)((places + 1u) & 7u);"),
    ],
}

# For WP: the steps of the proof.
STEPS = {
    "onebit_fixed.h": [
        (
            """/*@ loop invariant 0 <= k <= count;
                loop invariant room == INT32_MAX - magnitudes(row, k);
                loop invariant valid_row(row, k);
                loop assigns k, room;
                loop variant count - k; */""",
            "for (unsigned k = 0; k < count; ++k) {\n        uint32_t magnitude =",
        ),
        (
            "//@ assert magnitudes(row, k + 1) == magnitudes(row, k) + magnitude;",
            "if (magnitude > room) {",
        ),
    ],
    "onebit_processor.h": [
        (
            """/*@ loop invariant 0 <= k <= count;
                loop invariant -0x80000000 * magnitudes(left, k) <= sum
                    <= 0x80000000 * magnitudes(left, k);
                loop assigns k, sum;
                loop variant count - k; */""",
            "for (unsigned k = 0; k < count; ++k) {\n        sum +=",
        ),
        (
            "//@ assert magnitudes(left, k + 1) == magnitudes(left, k) + magnitude(left[k]);",
            "sum += onebit_product(left[k], right[k]);",
        ),
        (
            "//@ assert right == 0x10000 * right_upper + right_lower;",
            "int32_t middle = onebit_scaled_signed_by_halves(left, right_lower);",
        ),
        (
            """//@ assert left == 0x10000 * (left >> 16) + left_lower;
            /*@ assert left * right_upper ==
                0x10000 * ((left >> 16) * right_upper) + left_lower * right_upper; */
            //@ assert left * right == 0x10000 * (left * right_upper) + left * right_lower;
            /*@ assert second ==
                left_lower * right_upper + middle - 0x10000 * (middle >> 16); */
            //@ assert 0 <= left * right - 0x100000000 * upper < 0x100000000;
            //@ assert upper_word(left, right, upper);""",
            "return (int64_t)((uint64_t)upper << 32",
        ),
    ],
}

# Octagons carry a difference of two variables along, the other domains what an expression was
# found to be. Branches are followed apart (slevel) but for the neighbour found by its number, any
# of which will do; and where a function returns a status, what it was returned for is kept apart.
EVA = [
    "-eva",
    "-warn-invalid-pointer",
    "-eva-domains=octagon,equality,symbolic-locations",
    "-eva-slevel=100",
    "-eva-slevel-function=take:0,check_thresholds:0,onebit_leading_zeros_by_steps:1000",
    "-eva-auto-loop-unroll=64",
    "-eva-use-spec=onebit_products",
    "-eva-split-return=auto",
    "-eva-split-return-function=check_gains:0",
    "-eva-msg-key=-initial-state,-final-states",
]

# Verbs that accept some of their inputs and so were followed to their end.
REACHED = {
    *("check", "start", "encode", "send", "send_message", "receive", "receive_message", "control"),
    *("advance", "valid", "update"),
    *("decode", "frame_encode", "sync", "is_sync", "word", "name", "end"),
}

WP = ["-wp", "-wp-rte", "-wp-prover=cvc4", "-wp-timeout=20", "-wp-par=2"]
LEMMAS = [
    *("onebit_row_valid", "onebit_dot", "onebit_products", "onebit_product"),
    *("onebit_project", "onebit_beyond"),
]
BY_HALVES = [
    *("onebit_product_by_halves", "onebit_scaled_signed_by_halves", "onebit_half"),
]


def annotated(directory, annotations, library=LIBRARY):
    """A copy of lib/ with the annotations in it."""
    directory.mkdir(parents=True, exist_ok=True)
    for path in library.glob("onebit*.[ch]"):
        text = path.read_text()
        for annotation, place in annotations.get(path.name, []):
            if text.count(place) != 1:
                raise ValueError(f"{path.name} has {text.count(place)} times: {place}")
            text = text.replace(place, f"{annotation}\n    {place}")
        (directory / path.name).write_text(text)
    return directory


def frama_c(processor, directory, lib, source, options):
    """Frama-C's output, and of each property its function, kind, text and status."""
    machine, macros = PROCESSORS[processor]
    report = directory / "properties.csv"
    environment = {**os.environ, "WHY3CONFIG": str(directory / "why3.conf")}
    if options[0] == "-wp":
        subprocess.run(
            ["why3", "config", "detect"], env=environment, check=True, capture_output=True
        )
    command = [
        "frama-c",
        f"-machdep={machine}",
        f"-cpp-extra-args={' '.join([f'-I{lib}', *macros])}",
        str(source),
        *options,
        "-then",
        f"-report-csv={report}",
    ]
    run = subprocess.run(command, env=environment, check=False, capture_output=True, text=True)
    (directory / "output").write_text(run.stdout + run.stderr)
    if run.returncode != 0:
        raise RuntimeError(run.stdout + run.stderr)
    with report.open(newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE))
    return run.stdout, [
        ((row["function"], row["property kind"], row["property"]), row["status"])
        for row in rows
        if not row["function"].startswith("Frama_C_")
        or row["property kind"].startswith("precondition")
    ]


def prove(processor, directory, library=LIBRARY):
    """What is not proved of the library on a processor; empty if all is."""
    directory = pathlib.Path(directory).resolve() / processor
    functions = LEMMAS + (BY_HALVES if processor == "cortex-m0" else [])
    lib = annotated(directory / "wp", STEPS, library)
    _, properties = frama_c(
        processor,
        directory / "wp",
        lib,
        HERE / "lemmas.c",
        [*WP, f"-wp-fct={','.join(functions)}"],
    )
    complaints = [
        f"WP: {status}: {what}"
        for what, status in properties
        if what[0] in functions
        and status not in ("Valid", "Considered valid")
        and what[1] != "precondition"  # stands with each call, as "precondition of .."
    ]
    proved = {what for what, status in properties if status == "Valid" and what[0] in functions}
    missing = {name for name in functions if not any(what[0] == name for what in proved)}
    complaints += [f"WP: nothing proved of {name}" for name in sorted(missing)]

    lib = annotated(directory / "eva", CASES, library)
    output, properties = frama_c(processor, directory / "eva", lib, HERE / "verbs.c", EVA)
    complaints += [
        f"Eva: {status}: {what}"
        for what, status in properties
        if status not in ("Valid", "Considered valid") and what not in proved
    ]
    complaints += [
        f"Eva: no way to {name}"
        for name in sorted(REACHED)
        if f"Frama_C_show_each_{name}:" not in output
    ]
    return complaints


def main():
    complaints = 0
    for processor in PROCESSORS:
        for complaint in prove(processor, *sys.argv[1:] or ["build/proof"]):
            print(f"{processor}: {complaint}")
            complaints += 1
    print(f"{complaints} not proved")
    return int(complaints != 0)


if __name__ == "__main__":
    sys.exit(main())
