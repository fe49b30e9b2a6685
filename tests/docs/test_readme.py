"""The README: short, up to date, no link that leads nowhere; the committed long forms hold what the pages tell of them."""

import json
import re

import pytest

from docs._generate import markdown, pages, readme
from tests.conftest import FIGURES, ROOT

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
DEMANDS = (
    "Show what accuracy costs in time, test that hard cases stay numerically stable, "
    "and simulate only the effects a scene calls for."
)
LINK = re.compile(r"\]\(([^)\s]+)\)")


def test_its_numbers_and_tables_are_those_of_the_committed_results():
    assert readme.updated(TEXT) == TEXT, "python -m docs._generate.readme brings them up to date"


def test_it_is_short_and_states_the_demands_and_the_two_commands():
    lines = TEXT.splitlines()
    assert len(lines) <= 180
    assert DEMANDS in lines
    assert sum(line.startswith('pip install -e ".[test]" && ') for line in lines) == 1
    assert sum(line.startswith('pip install -e ".[training]" && ') for line in lines) == 1


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_links_lead_to_files_that_are_kept(page):
    for target in LINK.findall((ROOT / page).read_text(encoding="utf-8")):
        if not target.startswith(("http://", "https://", "#")):
            assert (ROOT / target.partition("#")[0]).exists(), f"{page}: {target}"


def test_every_included_table_is_generated_and_every_generated_one_is_shown():
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md") if "_generated" not in path.parts]
    included = {name for text in texts for name in re.findall(r"_generated/([\w.+-]+)\n", text)}
    unshown = {"header_FlagGoalDense-v0.md"}  # the page of both goal ids opens with the other's
    assert included == set(pages()) - unshown


def test_a_numpydoc_section_is_read():
    def function(a, b, c):
        """Do.

        Parameters
        ----------
        a, b : (2,)
            Two
            numbers [m].
        c
            A third.

        Returns
        -------
        d
            Not a parameter.
        """

    assert markdown.parameters(function) == {"a": "Two numbers [m].", "b": "Two numbers [m].", "c": "A third."}


def test_a_million_steps_under_fire_brought_no_bad_number():
    kept = json.loads(FIGURES.read_text())["cases"]
    runs = [figures for name, figures in kept.items() if "test_no_action_brings_a_bad_number[28000" in name]
    assert sum(figures["steps"] for figures in runs) >= 1e6
    assert all(figures["non-finite numbers, observations outside, divergences"] == [0, 0, 0] for figures in runs)
