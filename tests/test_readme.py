"""README.md against the tree: its example is the file that a test builds, its facts hold."""

import re

import pytest
import yaml
from simulator import ROOT, SCENARIOS, call

TEXT = (ROOT / "README.md").read_text()


def test_firmware_example_is_the_compiled_file():
    block = re.search(r"```c\n(.*?)```", TEXT, re.S)[1]
    assert block == (ROOT / "lib/example/pump.c").read_text()


def test_links_lead_somewhere():
    targets = re.findall(r"\]\(([^)#]+)\)", TEXT)
    assert len(targets) > 8
    for target in targets:
        assert (ROOT / target).exists(), target


PORTS = ROOT / "ports"


@pytest.mark.parametrize(
    "path", sorted(PORTS.rglob("README.md")), ids=lambda path: path.parent.name
)
def test_links_of_the_ports_lead_somewhere(path):
    for target in re.findall(r"\]\(([^)#]+)\)", path.read_text()):
        assert (path.parent / target).exists(), target


def test_every_port_is_in_the_index():
    listed = re.findall(r"^\| \[([\w-]+)\]\(\1\) \|", (PORTS / "README.md").read_text(), re.M)
    assert sorted(listed) == sorted(path.name for path in PORTS.iterdir() if path.is_dir())


def test_anchors_lead_somewhere():
    titles = re.findall(r"^## (.*)$", TEXT, re.M)
    anchors = {re.sub(r"[^a-z0-9 -]", "", title.lower()).replace(" ", "-") for title in titles}
    for anchor in re.findall(r"\]\(#([^)]+)\)", TEXT):
        assert anchor in anchors


@pytest.mark.parametrize("verb", ["run", "replay"])
def test_documented_options_exist(verb):
    """Every option of the README's command lines stands in the verb's help."""
    help_text = call(verb, "--help").stdout
    for line in re.findall(rf"onebit-sim {verb} (.*)", TEXT):
        for option in re.findall(r"--[a-z-]+", line):
            assert option in help_text


def test_scenario_keys_are_those_of_the_scenarios():
    """The format's block names the same sections and keys as the files, or fewer."""
    block = re.search(r"```yaml\n(.*?)```", TEXT, re.S)[1].replace("..", "0")
    documented = yaml.safe_load(block)
    for path in SCENARIOS.glob("*.yaml"):
        content = yaml.safe_load(path.read_text())
        assert set(content) <= set(documented), path
        for section, keys in content.items():
            if isinstance(keys, dict):
                assert set(keys) <= set(documented[section]), (path, section)
