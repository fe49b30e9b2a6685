"""Numbers that the pages' sentences quote, as MyST substitutions: `{{ gain }}`."""

from __future__ import annotations

from docs._generate import studies, training
from docs._generate.markdown import percent


def quoted() -> dict[str, str]:
    """Name -> text."""
    accuracy, effects, speed = (studies.read(name) for name in ("accuracy", "effects", "speed"))
    stability, flutter = studies.read("stability"), studies.read("flutter")
    wind, mast, vector = (training.read(name) for name in ("wind_breeze_ppo", "mast_breeze_ppo", "vector_speed"))
    points = accuracy["rows"]
    floors = [
        min(row["RMS error [m]"] for row in points if row["scene"] == scene and row["dtype"] == "float32")
        for scene in accuracy["presets"]
    ]
    random = stability["random"]
    starts = effects["starts"]
    figure = {row["figure"]: row for row in speed["rows"]}
    flags = [row["sum / whole step"] for row in effects["agreement"]]
    limits = [v for row in stability["limit_times"][:16] for v in row.values() if isinstance(v, float)]
    balanced = next(row for row in accuracy["presets"]["Flag-v0"] if row["accuracy"] == "balanced")
    return {
        "gain": f"{accuracy['gain']:.0f}",
        "float32_floor": f"{1e6 * min(floors):.1f} to {1e6 * max(floors):.1f} micrometres",
        "balanced_error": f"{balanced['error after 1 s [mm]']:.2g} mm",
        "balanced_time": f"{balanced['1 s takes [ms]']:.2g} ms",
        "growth_gusty": f"{accuracy['growth']['gusty']['rate']:.2f}",
        "horizon_gusty": f"{accuracy['growth']['gusty']['horizon']:.0f} s",
        "random_scenes": str(sum(row["scenes"] for row in random)),
        "blow_ups": str(sum(row["blow-ups at 0.95"] for row in random)),
        "least_blow_up": f"{min(row['blow-up, least'] for row in random):.2f}",
        "limit_times": f"{min(limits):.0f} to {max(limits):.0f} ms",
        "parts_agree": percent(max(abs(share - 1) for share in flags)),
        "start_cached": f"{max(row['from cache [s]'] for row in starts):.1f} s",
        "start_new": "{:.1f} to {:.1f} s".format(*_ends(row["new combination [s]"] for row in starts)),
        "start_first": "{:.1f} to {:.1f} s".format(*_ends(row["nothing compiled [s]"] for row in starts)),
        "onset": f"{flutter['onset (m/s)']:.2f} m/s",
        "onset_theory": f"{flutter['onset by linear theory (m/s)']:.2f} m/s",
        "steps_per_second": f"{figure['Flag-v0, one environment']['measured']:_.0f}".replace("_", " "),
        "plain_ratio": f"{figure['one 20 x 32 flag, float32']['measured']:.1f}",
        "mujoco_ratio": f"{figure['the same against MuJoCo flex']['measured']:.0f}",
        "ppo_success": percent(wind["mean"]["success_5"]),
        "ppo_seconds": f"{max(row['seconds'] for row in wind['seeds']):.0f} s",
        "mast_success": percent(mast["mean"]["success_5"]),
        "mast_minutes": f"{max(row['seconds'] for row in mast['seeds']) / 60:.0f} minutes",
        "vector_seconds": "{:.0f} s and {:.0f} s".format(*vector["seconds"].values()),
    }


def _ends(values: object) -> tuple[float, float]:
    found = list(values)  # type: ignore[call-overload]
    return min(found), max(found)
