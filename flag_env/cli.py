"""The `flag-env` command."""

from __future__ import annotations

import sys
from pathlib import Path


def targets(output: Path = Path(__file__).parent / "tasks" / "data", seed: int = 0, quick: bool = False) -> None:
    """Build the library of target poses, replay every witness and write the files.

    Args:
        output: folder of the files.
        seed: seed of the witnesses and hidden winds.
        quick: build nothing; only replay the witnesses that are there.
    """
    from tqdm import tqdm

    from flag_env.control import CONTROLS
    from flag_env.envs import certify
    from flag_env.envs.batch import LEVELS, Settings
    from flag_env.tasks.targets import SIZES, SPLITS, read_targets

    for control in CONTROLS:
        for level in LEVELS:
            path = output / f"{control}_{level}.npz"
            if not quick:
                with tqdm(total=sum(SIZES.values()), desc=f"{control} {level}") as bar:
                    certify.save(path, certify.build(control, level, seed, bar.update))
            for split in SPLITS:
                worst = max(certify.check(Settings(control, level, split), read_targets(path, split)))
                print(f"{path.name} {split:10}: {SIZES[split]} targets, worst distance {100 * worst:.2f} % of the diagonal")
                if worst >= certify.STEADY:
                    sys.exit(f"a witness of {path} does not reach its target")


def speed(output: Path = Path("runs/speed"), quick: bool = False) -> None:
    """Measure the simulator's speed beside a plain Numba flag.

    Args:
        output: folder for speed.json and speed.png.
        quick: fewer repetitions.
    """
    from flag_env.studies.speed import run

    run(output, quick)


def effects(output: Path = Path("runs/effects"), quick: bool = False) -> None:
    """Measure what each effect costs in its scene, and how fast scenes start.

    Args:
        output: folder for effects.json and effects.png.
        quick: fewer repetitions, one start.
    """
    from flag_env.studies.effects import run

    run(output, quick)


def flutter(output: Path = Path("runs/flutter"), quick: bool = False) -> None:
    """Measure from which wind on a flag flutters, beside linear theory.

    Args:
        output: folder for flutter.json and flutter.png.
        quick: a coarser flag and fewer winds.
    """
    from flag_env.studies.flutter import run

    run(output, quick)


def stability(output: Path = Path("runs/stability"), quick: bool = False) -> None:
    """Map which timesteps keep a flag stable, beside the limit that is known before it runs.

    Args:
        output: folder for stability.json and stability.png.
        quick: coarser maps and fewer random scenes.
    """
    from flag_env.studies.stability import run

    run(output, quick)


def record(output: Path = Path("runs/scenes"), quick: bool = False) -> None:
    """Record every preset scene in motion, and a gallery of them.

    Args:
        output: folder for a GIF of each scene and gallery.png.
        quick: the gallery alone.
    """
    from flag_env.studies.gallery import run

    run(output, quick)


def accuracy(output: Path = Path("runs/accuracy"), quick: bool = False) -> None:
    """Measure what accuracy costs in time: integrators, timesteps, dtypes, lattices, and how far a pose can be foretold.

    Args:
        output: folder for accuracy.json and accuracy.png; a run that was stopped goes on there.
        quick: fewer timesteps, lattices and seconds.
    """
    from flag_env.studies.accuracy import run

    run(output, quick)


def main() -> None:
    """Run a subcommand."""
    try:
        import tyro
    except ImportError:
        sys.exit('the flag-env command needs the extra "cli": pip install -e ".[cli]"')
    tyro.extras.subcommand_cli_from_dict(
        {
            "accuracy": accuracy,
            "effects": effects,
            "flutter": flutter,
            "record": record,
            "speed": speed,
            "stability": stability,
            "targets": targets,
        },
        description="Studies and tools of flag_env.",
    )
