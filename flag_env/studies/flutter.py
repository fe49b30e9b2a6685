"""The wind from which a flag flutters, how fast and how far: growth rate, amplitude, frequency and Strouhal number over speed.

A flag of constant thickness without weight lies flat in a wind along it, an exact equilibrium; so the growth rate of a small
deflection is defined, and known from linear theory. With w(x, t) the deflection, mu the areal density and q = rho / 2,

    mu (w_tt + c w_t) = (T w_x)_x + (N w_xt)_x - q C_N U (w_t + U w_x) + q C_F U^2 w_x,    T = q C_F U^2 (length - x),

N the links' viscosity for deflections [N s/m], w = 0 at the mast and the far edge free. The springs add no stiffness to a flat
cloth beyond the tension T that the air's friction puts on it. Waves slower than the wind gain energy from it; the linear drag c
and the viscosity take some. Where gain and loss are even lies the onset.

Theory and measurement agree on growth above the onset within 5 %. Below it they agree on decay within 10 %, but for the slowest
wind: there several waves die side by side, and the rate measured is none of a single one. The onset is found by linear
interpolation between two winds, and that of the coarser flag of a quick run lies 2 % higher.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from tqdm import tqdm

from flag_env.physics import Scene, Simulator, effects, presets
from flag_env.studies import report

SPEEDS = (0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
"""Winds [m/s]."""

SMALL, LARGE, LINEAR = 1e-8, 0.05, 1e-3
"""Deflections at the start, to see growth and to see flutter, and the largest RMS one that linear theory is asked of [m]."""

QUICK = (0.75, 1.25, 1.5, 2.0, 3.0, 6.0, 12.0)
"""Winds of a quick run [m/s]; those beside the onset are the same, since it is found between them."""

SLOW = 0.75
"""Least angular frequency of a wave along the flag, in wind speeds / length."""

SAMPLE = 0.02
"""Time between two samples [s]."""


def scene(rows: int = 10, cols: int = 16) -> Scene:
    """The flag: `presets.flag` without weight and taper, in a wind along x."""
    return presets.flag(rows, cols, taper=1.0, drag=0.5, perturbation=0.0).without(effects.Gravity, effects.CosineWind).adding(
        effects.AirPressure()
    )  # fmt: skip


def theory(scene: Scene, speed: float, points: int = 240) -> complex:
    """Growth rate (real) and angular frequency (imaginary) of the fastest growing, or slowest dying, wave along the flag [1/s].

    Modes slower than `SLOW` are no waves along it and left out: where the tension vanishes, at the free edge, there is a
    continuum of them that decay ever more slowly the finer the grid, and that no lattice shows. The rest depends on the grid by
    less than 2 %.
    """
    lattice, found = scene.lattice, {type(effect): effect for effect in scene.effects}
    air, drag = found[effects.AirPressure], found[effects.AirDrag]
    along = lattice.spacings[0]
    length, dx = lattice.extent[0], lattice.extent[0] / points
    mu = lattice.mass * lattice.size / (lattice.extent[0] * lattice.extent[1])
    # squares of how far the links of a row reach along x, counted per row: neighbours 1, two diagonals, second neighbours 4
    reach = ((effects.Structural, 1.0), (effects.Shear, 2.0 * (lattice.rows - 1) / lattice.rows), (effects.Bending, 4.0))
    height = lattice.extent[1] / lattice.rows
    viscosity = sum(getattr(found[kind], "viscosity", 0.0) * weight for kind, weight in reach) * along / height
    q = 0.5 * getattr(air, "density", 0.0)
    normal, friction = getattr(air, "normal", 0.0), getattr(air, "friction", 0.0)
    between = (np.arange(points) + 0.5) * dx
    slope = (np.eye(points) - np.eye(points, k=-1)) / dx  # at the midpoints; w = 0 at the mast
    cell = np.full(points, dx)
    cell[-1] *= 0.5
    divergence = (np.eye(points, k=1) - np.eye(points)) / cell[:, None]  # nothing pulls beyond the free edge
    centre = 0.5 * (slope + np.vstack([slope[1:], slope[-1:]]))
    stiffness = divergence @ np.diag(q * friction * speed**2 * (length - between)) @ slope
    stiffness += q * (friction - normal) * speed**2 * centre
    damping = divergence @ slope * viscosity - (q * normal * speed + mu * getattr(drag, "rate", 0.0)) * np.eye(points)
    system = np.block([[np.zeros((points, points)), np.eye(points)], [stiffness / mu, damping / mu]])
    values = np.linalg.eigvals(system)
    waves = values[values.imag > SLOW * speed / length]
    return complex(waves[np.argmax(waves.real)])


def deflections(
    scene: Scene, speeds: tuple[float, ...], seconds: float, start_at: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Time (samples,) [s], deflection of the tip and RMS deflection (samples, speeds) [m]: one flag for each wind."""
    sim = Simulator(scene, len(speeds))
    wind = np.zeros((len(speeds), 3))
    wind[:, 0] = speeds
    sim.set_wind(mean=wind)
    start = scene.lattice.rest_positions.copy()
    x = start[..., 0] / scene.lattice.extent[0]
    start[..., 1] = start_at * x * np.sin(7.0 * x)
    sim.set_positions(start)
    steps = max(1, round(SAMPLE / sim.timestep))
    count = int(seconds / (steps * sim.timestep))
    tip, rms = np.empty((2, count, len(speeds)))
    for i in tqdm(range(count), desc="flutter", leave=False):
        sim.step(steps)
        y = sim.positions[:, 0, :, :, 1]
        tip[i], rms[i] = y[:, :, -1].mean(axis=1), np.sqrt((y**2).mean(axis=(1, 2)))
    return np.asarray(steps * sim.timestep * np.arange(1, count + 1), np.float64), tip, rms


def growth(time: NDArray[np.float64], rms: NDArray[np.float64]) -> float:
    """Slope of the logarithm of the RMS deflection over the second half of the time in which it is small [1/s]."""
    large = np.flatnonzero(rms > LINEAR)
    last = int(large[0]) if len(large) else len(rms)
    part = slice(last // 2, last)
    return float(np.polyfit(time[part], np.log(rms[part]), 1)[0])


def measure(scene: Scene, speeds: tuple[float, ...], seconds: float) -> list[dict[str, Any]]:
    """Growth from a small deflection and flutter from a large one, a row for each wind.

    Below the onset the tip's amplitude is what is left of the large deflection.
    """
    time, _, rms = deflections(scene, speeds, seconds, SMALL)
    rates = [growth(time, rms[:, k]) for k in range(len(speeds))]
    time, tip, _ = deflections(scene, speeds, seconds, LARGE)
    return [_row(scene, *case, time, tip[:, k]) for k, case in enumerate(zip(speeds, rates, strict=True))]


def _row(scene: Scene, speed: float, rate: float, time: NDArray[np.float64], tip: NDArray[np.float64]) -> dict[str, Any]:
    frequency, power = spectrum(time, tip)
    amplitude = float(np.sqrt(2.0) * tip[len(tip) // 2 :].std())
    peak = int(power.argmax())
    expected = theory(scene, speed)
    return {
        "wind speed (m/s)": speed,
        "growth rate (1/s)": rate,
        "theory (1/s)": expected.real,
        "tip amplitude (m)": amplitude,
        "frequency (Hz)": float(frequency[peak]),
        "theory (Hz)": abs(expected.imag) / (2.0 * np.pi),
        "Strouhal number": float(2.0 * frequency[peak] * amplitude / speed),
        "share of the peak": float(power[max(peak - 2, 0) : peak + 3].sum() / power.sum()),
        "tip (m)": tip[len(tip) // 2 :].tolist(),
        "sample (s)": float(time[1] - time[0]),
    }


def spectrum(time: NDArray[np.float64], tip: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies [Hz] and power of the second half of the tip's deflection, Hann window."""
    late = tip[len(tip) // 2 :]
    late = (late - late.mean()) * np.hanning(len(late))
    frequency = np.asarray(np.fft.rfftfreq(len(late), float(time[1] - time[0])), np.float64)
    return frequency, np.asarray(np.abs(np.fft.rfft(late)) ** 2, np.float64)


def onset(rows: list[dict[str, Any]], column: str = "growth rate (1/s)") -> float | None:
    """Wind speed at which the growth rate passes zero [m/s], linear between two speeds; None if it does not among the rows."""
    for low, high in pairwise(rows):
        a, b = low[column], high[column]
        if a <= 0 < b:
            return float(low["wind speed (m/s)"] - a * (high["wind speed (m/s)"] - low["wind speed (m/s)"]) / (b - a))
    return None


def run(output: Path, quick: bool) -> None:
    """Measure, print the table, write flutter.json and flutter.png; Strouhal number = frequency x twice the amplitude / speed."""
    case = scene() if quick else scene(20, 32)
    rows = measure(case, QUICK if quick else SPEEDS, seconds=20.0 if quick else 40.0)
    figure = _figure(rows)
    shown = [{name: value for name, value in row.items() if name not in ("tip (m)", "sample (s)")} for row in rows]
    speeds = {"onset (m/s)": onset(rows), "onset by linear theory (m/s)": onset(rows, "theory (1/s)")}
    report.write(output, "flutter", shown, figure, **speeds)
    print(", ".join(f"{name}: {'none' if value is None else f'{value:.3g}'}" for name, value in speeds.items()))


def _figure(rows: list[dict[str, Any]]) -> Figure:
    figure = Figure(figsize=(9, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    fluttering = [row for row in rows if row["growth rate (1/s)"] > 0][::-1]
    for shade, row in zip(np.linspace(1.0, 0.3, max(len(fluttering), 1)), fluttering, strict=False):
        tip = np.array(row["tip (m)"])
        late = (tip - tip.mean()) * np.hanning(len(tip))
        power = np.abs(np.fft.rfft(late)) ** 2 / len(late) ** 2
        frequency = np.fft.rfftfreq(len(late), row["sample (s)"])
        left.semilogy(frequency, power, color="#c8372d", alpha=shade, lw=1, label=f"{row['wind speed (m/s)']:g} m/s")
    left.set(xlim=(0, 20), xlabel="frequency (Hz)", ylabel="power of the tip's deflection (m$^2$)", title="Tip spectra")
    left.set_ylim(1e-14, None)
    left.legend(frameon=False, fontsize=8)
    speed = [row["wind speed (m/s)"] for row in rows]
    right.plot(speed, [row["tip amplitude (m)"] for row in rows], "o-", color="#c8372d", label="tip amplitude")
    right.set(xlabel="wind speed (m/s)", ylabel="tip amplitude (m)", title="Amplitude and growth")
    rate = right.twinx()
    rate.plot(speed, [row["growth rate (1/s)"] for row in rows], "s", color="#4a5560", label="growth rate")
    rate.plot(speed, [row["theory (1/s)"] for row in rows], "--", color="#4a5560", label="linear theory")
    rate.axhline(0.0, color="#9aa3ad", lw=0.8)
    rate.set_ylabel("growth rate (1/s)")
    lines = [*right.get_lines(), *rate.get_lines()[:2]]
    right.legend(lines, [str(line.get_label()) for line in lines], frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.06))
    left.spines["right"].set_visible(False)
    for axes in (left, right, rate):
        axes.spines["top"].set_visible(False)
    return figure
