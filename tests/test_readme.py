"""What the README says about hard cases is what the last run of the long forms measured."""

import json

import pytest

from tests.conftest import FIGURES, ROOT

HARD = "tests/physics/test_hard_cases.py::test_"
APART = "RMS distance to one never disturbed / diagonal"


def margin(name):
    return lambda f: f"| `{name}` | {f['scenes']} | {f['blow-ups at 0.95']} | {f['blow-up, least']:.2f} | {f['median']:.2f} |"


SAID = {
    HARD + "no_random_flag_blows_up_below_its_limit[Leapfrog(start='report')-300]": margin("Leapfrog"),
    HARD + "no_random_flag_blows_up_below_its_limit[LFAB()-300]": margin("LFAB"),
    HARD + "no_random_flag_blows_up_below_its_limit[Strang(iterations=1)-300]": margin("Strang"),
    HARD + "no_random_flag_blows_up_below_its_limit[RK4()-300]": margin("RK4"),
    HARD + "no_random_flag_blows_up_below_its_limit[ExplicitEuler()-300]": margin("ExplicitEuler"),
    HARD + "a_tip_of_little_mass[100.0-0.01]": lambda f: f"strain {100 * f['strain at the end']:.0f} % and",
    HARD + "a_tip_of_little_mass[100.0-0.001]": lambda f: f"and {100 * f['strain at the end']:.0f} %",
    HARD + "wind_of_fifty_weights[100.0]": lambda f: f"largest strain {100 * f['largest strain']:.0f} %",
    HARD + "a_flag_recovers_from[100.0-crumpled]": lambda f: f", {100 * f[APART]:.0f} %, 0.002 %",
    HARD + "a_mast_teleported_by_ten_flags_gets_its_flag_back[100.0-LFAB()]": (
        lambda f: f"strain {100 * f['strain after the jump']:.0f} % (`LFAB`)"
    ),
    HARD + "a_mast_shaken_at_twenty_hertz[100.0]": lambda f: f"largest strain {100 * f['largest strain']:.0f} %; ",
    **{
        f"{HARD}energy_does_not_drift_without_damping[1000000-{share}]": (
            lambda f: "{:.1f} to {:.1f}".format(*(1e6 * end for end in f["slope interval [m per block]"]))
        )
        for share in (0.25, 0.5, 0.9)
    },
    "tests/training/test_kills.py::test_twenty_kills": lambda f: f"{f['kills']} of 20",
}


@pytest.mark.parametrize("case", SAID)
def test_the_table_of_hard_cases_holds_what_was_measured(case):
    kept = json.loads(FIGURES.read_text())["cases"]
    assert SAID[case](kept[case]) in (ROOT / "README.md").read_text()


def test_a_million_steps_under_fire_brought_no_bad_number():
    kept = json.loads(FIGURES.read_text())["cases"]
    runs = [figures for name, figures in kept.items() if "test_no_action_brings_a_bad_number[28000" in name]
    steps = sum(figures["steps"] for figures in runs)
    assert steps >= 1e6
    assert f"{steps:_} steps: 0, 0, 0".replace("_", " ") in (ROOT / "README.md").read_text()
    assert all(figures["non-finite numbers, observations outside, divergences"] == [0, 0, 0] for figures in runs)
