"""Frama-C finds nothing left to prove of the q31 library, and does find what is spoilt.

What is proved, and under which assumptions: tests/proof/verbs.c and tests/proof/lemmas.c.
"""

import shutil

import pytest
from programs import need
from proof import prove

# Defects, one a function, and what must be said of each.
DEFECTS = {
    "a row too large passes": (
        ("onebit_fixed.h", "room -= magnitude;", "room -= magnitude >> 1;"),
        "WP: Unknown: ('onebit_row_valid', 'loop invariant'",
    ),
    "F's argument keeps no bound below": (
        ("onebit_fixed.h", "(z < least ? least : (z > most ? most : z))", "(z > most ? most : z)"),
        "Eva: Unknown: ('onebit_cdf_minus', 'mem_access'",
    ),
    "a large step is not limited": (
        ("onebit_fixed.h", "if (product > limit || product < -limit) {", "if (product > limit) {"),
        "Eva: Unknown: ('onebit_accumulate', 'signed_overflow'",
    ),
    "an estimate is projected from above only": (
        ("onebit_fixed.h", "(uint32_t)value + (uint32_t)limit > 2u", "(uint32_t)value > 2u"),
        "WP: Unknown: ('onebit_beyond', 'postcondition'",
    ),
    "a neighbour beyond the last is found": (
        ("onebit_agent.c", "while (k < config->neighbour_count &&", "while (k < 32 &&"),
        "Eva: Unknown: ('take', 'mem_access'",
    ),
}


@pytest.fixture(scope="module", autouse=True)
def tools():
    need("frama-c", "frama-c-base")
    need("why3", "why3")
    need("cvc4", "cvc4")


@pytest.mark.parametrize("processor", prove.PROCESSORS)
def test_nothing_is_left_to_prove(processor, tmp_path):
    assert prove.prove(processor, tmp_path) == []


def test_defects_are_found(tmp_path):
    library = shutil.copytree(prove.LIBRARY, tmp_path / "spoilt")
    for (name, sound, spoilt), _ in DEFECTS.values():
        text = (library / name).read_text()
        assert text.count(sound) == 1, sound
        (library / name).write_text(text.replace(sound, spoilt))
    complaints = prove.prove("rv32imac", tmp_path, library)
    for defect, (_, expected) in DEFECTS.items():
        assert any(complaint.startswith(expected) for complaint in complaints), (defect, complaints)
