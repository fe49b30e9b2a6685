"""Tables of the studies' pages, from `flag_env/studies/results` and the long forms of the hard cases."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from docs._generate.markdown import table

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "flag_env" / "studies" / "results"
CASES = ROOT / "tests" / "results" / "hard_cases.json"

Row = dict[str, Any]


def read(name: str) -> Any:
    """A study's results."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def pages() -> dict[str, str]:
    """Tables of all studies, and where each was measured."""
    studies = {path.stem: read(path.stem) for path in sorted(RESULTS.glob("*.json"))}
    promised = studies.pop("promises", None)
    found = {f"machine_{name}.md": machine(result["machine"]) for name, result in studies.items()}
    accuracy, effects, stability = studies["accuracy"], studies["effects"], studies["stability"]
    return found | {
        "accuracy_presets.md": rows(accuracy["presets"]["Flag-v0"]),
        "accuracy_promises.md": promises(promised),
        "accuracy_space.md": space(accuracy["space"]),
        "accuracy_growth.md": growth(accuracy["growth"]),
        "accuracy_averages.md": averages(accuracy["averages"]),
        "effects_cost.md": costs(effects["rows"]),
        "effects_agreement.md": rows(effects["agreement"]),
        "effects_starts.md": rows(effects["starts"]),
        "stability_maps.md": rows(stability["rows"]),
        "stability_random.md": rows(stability["random"]),
        "stability_limit_times.md": rows(stability["limit_times"]),
        "stability_heating.md": rows(stability["heating"]),
        "stability_finite_check.md": rows(stability["finite_check"]),
        "gradients_cost.md": rows(studies["gradients"]["rows"]),
        "gradients_horizon.md": rows(studies["gradients"]["horizon"]),
        "flutter.md": rows(studies["flutter"]["rows"]),
        "speed.md": speed(studies["speed"]["rows"]),
        "roofline.md": roofline(studies["speed"]["roofline"]),
        "hard_cases.md": hard_cases(),
    }


def machine(told: Row) -> str:
    """One line on where and when a study ran."""
    versions = ", ".join(f"{name} {told['versions'][name]}" for name in ("python", "numpy", "numba"))
    return f"*Measured on {told['date']}: {told['processor']}, {told['cores']} cores, {told['system']}; {versions}.*\n"


def rows(values: list[Row]) -> str:
    """Rows as they are in the file."""
    heads = list(values[0])
    return table([head.replace("_", " ") for head in heads], [[row[head] for head in heads] for row in values], right=True)


def promises(told: Any) -> str:
    """What was promised beside what is true, once it has been measured."""
    if told is None:
        return ""
    figure = "![Promised against true errors](../../flag_env/studies/results/promises.png)\n"
    return f"{figure}\n{machine(told['machine'])}\n{rows(told['summary'])}"


def space(values: list[Row]) -> str:
    """What a coarser lattice costs in shape, and in time against the finest."""
    finest = values[-1]["wall time per simulated s"]
    heads = ["lattice", "RMS at 0.5 s [mm]", "RMS at 1 s [mm]", "RMS at 2 s [mm]"]
    shown = [[*(row[head] for head in heads), f"1/{finest / row['wall time per simulated s']:.0f}"] for row in values[:-1]]
    return table([*heads, f"time, that of {values[-1]['lattice']} being 1"], shown, right=True)


def growth(values: dict[str, Row]) -> str:
    """How fast errors grow, and after how long a nanometre is a millimetre."""
    shown = [
        [scene, f"{row['rate']:.2f}", "never" if row["horizon"] is None else f"{row['horizon']:.0f}"]
        for scene, row in values.items()
    ]
    return table(["scene", "growth rate [1/s]", "1e-9 m become 1 mm after [s]"], shown, right=True)


def averages(values: list[Row]) -> str:
    """Averages past the horizon: mean and interval of each run."""
    shown = [
        [row["quantity"], row["run"], row["mean"], f"{row['low']:.3g} to {row['high']:.3g}", "yes" if row["agrees"] else "**no**"]
        for row in sorted(values, key=lambda row: row["quantity"])
    ]
    return table(["quantity", "run", "mean", "95 % interval", "agrees"], shown)


def costs(values: list[Row]) -> str:
    """Nanoseconds per particle-step: a row for each part, a column for each scene."""
    scenes, parts = (list(dict.fromkeys(row[key] for row in values)) for key in ("scene", "part"))
    last = ("sum", "whole step")
    parts = [*(part for part in parts if part not in last), *last]
    cost = {(row["part"], row["scene"]): f"{row['ns per particle-step']:.1f}" for row in values}
    shown = [[part, *(cost.get((part, scene), "") for scene in scenes)] for part in parts]
    return table(["ns per particle-step", *scenes], shown, right=True)


def speed(values: list[Row]) -> str:
    """Each figure with its bar, its aim and its spread."""

    def of(row: Row, key: str) -> str:
        return "" if row[key] == "" else f"{row[key]:.3g}" if abs(row[key]) < 1000 else f"{row[key]:.0f}"

    shown = [
        [
            row["figure"], of(row, "bar"), of(row, "aim"), f"**{of(row, 'measured')}** {row['unit']}",
            f"{of(row, 'least')} to {of(row, 'most')}", row["note"],
        ]
        for row in values
    ]  # fmt: skip
    return table(["figure", "bar", "aim", "measured", "least to most", "in numbers"], shown)


def roofline(told: Row) -> str:
    """What the kernel reaches of what the machine can."""
    able, flag, share = told["machine, in cache"], told["flag"], told["share of the machine's"]
    return table(
        ["", "the machine, in cache", "one 20 x 32 flag, float32", "share"],
        [[name, f"{able[name]:.3g}", f"{flag[name]:.3g}", f"{100 * share[name]:.0f} %"] for name in able],
        right=True,
    )


FORCES, RECOVERY, LIMIT, LATTICES = (
    f"tests/physics/test_hard_cases_{part}.py::test_" for part in ("forces", "recovery", "limit", "lattices")
)
FIRE = "tests/envs/test_under_fire.py::test_"
AWAY = "RMS distance to one never disturbed / diagonal"


def _share(key: str) -> Callable[[Row], str]:
    return lambda figures: f"{float(f'{100 * figures[key]:.2g}'):g} %"


def _micrometres(figures: Row) -> str:
    low, high = figures["slope interval [m per block]"]
    return f"{1e6 * low:.1f} to {1e6 * high:.1f} µm"


HELD: tuple[tuple[str, str, str, Callable[[Row], str] | None], ...] = (
    ("stiffness x 100 and x 10 000, viscosity x 1000, both", "automatic step; whole for 500 000 steps; strain at the end",
     FORCES + "extreme_links_take_an_automatic_step_and_stay_whole", _share("strain at the end")),
    ("tip mass 0.1 % and 1 % of the mast's", "whole after 100 s in wind; strain at the end",
     FORCES + "a_tip_of_little_mass", _share("strain at the end")),
    ("wind of 50 weights", "bounded over 100 s; largest strain", FORCES + "wind_of_fifty_weights", _share("largest strain")),
    ("wind at a natural frequency", "amplitude over F / (c w)",
     FORCES + "resonance_has_the_amplitude_of_the_linear_theory", lambda f: f"{f['amplitude / (F / (c w))']:.4f}"),
    ("particles on one spot, crumpled, folded over, turned over", "takes its old shape again; RMS distance to it after 100 s",
     RECOVERY + "a_flag_recovers_from", _share(AWAY)),
    ("two layers squeezed flat, swapped", "apart again; distance in thicknesses", RECOVERY + "two_layers_recover_from_being",
     lambda f: "{:.2f} to {:.2f}".format(*f["distance of the layers / thickness"])),
    ("zero rest length", "finite in both precisions, 100 s", RECOVERY + "links_of_no_length", None),
    ("mast teleported by ten flag lengths in 0.04 s", "takes its shape again; strain after the jump",
     RECOVERY + "a_mast_teleported_by_ten_flags_gets_its_flag_back", _share("strain after the jump")),
    ("mast shaken at 20 Hz", "takes its shape again; largest strain", RECOVERY + "a_mast_shaken_at_twenty_hertz",
     _share("largest strain")),
    ("no damping, at .25, .5, .9 of the limit, 10⁶ steps", "99.9 % interval of the drift a block, in height, holds zero",
     LIMIT + "energy_does_not_drift_without_damping", _micrometres),
    ("10⁷ steps in wind, float64 beside float32", "time means agree within their standard errors; differences",
     LIMIT + "statistics_of_both_precisions_agree", lambda f: ", ".join(f"{d:.1e}" for d in f["difference in float32"])),
    ("512 x 512 particles", "finite; falls with g", LATTICES + "a_large_lattice", None),
    ("1 x 1, 1 x N, N x 1, 2 x 2", "no access out of bounds, every effect and integrator",
     LATTICES + "no_effect_nor_integrator_leaves_its_arrays", None),
    ("scenes of any numbers, effects and integrators", "finite or `Diverged`; states go on to the bit",
     "tests/physics/test_any_scene.py::test_any", None),
    ("environments with any arguments", "promises kept, bad values refused by name",
     "tests/envs/test_any_arguments.py::test_", None),
    ("10⁵ episodes, 10⁴ frames", "growth of memory", FIRE + "memory_stays_flat", lambda f: f"{f['growth [MiB]']:.1f} MiB"),
    ("20 times SIGKILL", "the training resumes to the same bits", "tests/training/test_kills.py::test_twenty_kills",
     lambda f: f"{f['kills']} of 20"),
)  # fmt: skip
"""Case, what its tests hold, how their names begin, and what to show of their figures."""


def hard_cases() -> str:
    """What the long forms hold and measured; a case whose test is gone is an error."""
    cases: dict[str, Row] = json.loads(CASES.read_text(encoding="utf-8"))["cases"]
    shown = []
    for case, held, beginning, figure in HELD:
        found = [figures for name, figures in cases.items() if name.startswith(beginning)]
        if not found:
            raise ValueError(f"{CASES.name} holds no test that begins with {beginning}")
        shown.append([case, held, "; ".join(map(figure, found)) if figure else "holds"])
    runs = [figures for name, figures in cases.items() if name.startswith(FIRE + "no_action_brings_a_bad_number")]
    steps = sum(figures["steps"] for figures in runs)
    bad = [sum(counts) for counts in zip(*(next(v for v in f.values() if isinstance(v, list)) for f in runs), strict=True)]
    shown.append([
        "random, bang-bang and adversarial actions, every id, control and level",
        "numbers not finite, observations outside their space, divergences",
        f"{steps:_} steps: ".replace("_", " ") + ", ".join(map(str, bad)),
    ])  # fmt: skip
    return table(["case", "what the tests hold; what is measured", "in the long form"], shown)
