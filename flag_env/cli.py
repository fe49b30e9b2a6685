"""The `flag-env` command."""

from __future__ import annotations

import signal
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from flag_env._files import check_folder

if TYPE_CHECKING:
    from flag_env.viewer import Act, Task


def targets(
    output: Path = Path(__file__).parent / "tasks" / "data", seed: int = 0, only: tuple[str, ...] = (), quick: bool = False
) -> None:
    """Build the library of targets, replay every witness, and only then put the files in their place.

    Args:
        output: folder of the files.
        seed: seed of the witnesses and hidden winds.
        only: control/level of the files to build or replay, such as wind/wave; none: all.
        quick: build nothing; only replay the witnesses that are there.
    """
    from tqdm import tqdm

    from flag_env.envs import certify
    from flag_env.tasks import LEVELS, read_seed, rungs

    if seed < 0:
        sys.exit(f"error: seed must be at least 0, got {seed}")
    own = [(control, level) for control, level in rungs() if LEVELS[level].library is None]
    wrong = set(only) - {"/".join(task) for task in own}
    if wrong:
        sys.exit(f"error: only must name some of {', '.join('/'.join(task) for task in own)}, got {', '.join(sorted(wrong))}")
    named = {"_".join(task) + ".npz": task for task in own if not only or "/".join(task) in only}
    if quick:
        missing = [name for name in named if not (output / name).is_file()]
        if missing:
            sys.exit(f"error: output must hold a library of targets, got {output}, which lacks {', '.join(missing)}")
        try:
            seeds = {read_seed(output / name) for name in named}
        except ValueError as error:
            sys.exit(f"error: {error}")
        if len(seeds) > 1:
            sys.exit(f"error: output must hold a library of one seed, got {output} with {sorted(seeds)}")
        for name, task in named.items():
            _replay(output / name, *task)
        return
    _check_folder(output)
    try:
        with certify.swapped(output) as folder:
            for name, task in named.items():
                with tqdm(total=sum(LEVELS[task[1]].sizes.values()), desc=" ".join(task)) as bar:
                    certify.save(folder / name, certify.build(*task, seed, bar.update), seed)
                _replay(folder / name, *task)
    except FileExistsError as error:
        sys.exit(f"error: {error.filename} is there: another build is at work, or was killed; if none is at work, remove it")
    except KeyboardInterrupt:
        sys.exit(f"interrupted; {output} is as it was")


def _replay(path: Path, control: str, level: str) -> None:
    """Replay the witnesses of a library file; end the command if one does not reach its target."""
    from flag_env.envs import certify
    from flag_env.envs.config import FlagConfig
    from flag_env.tasks import LEVELS, read_targets

    for split in LEVELS[level].sizes:
        try:
            library = read_targets(path, split)
        except ValueError as error:
            sys.exit(f"error: {error}")
        config = FlagConfig(control, level, split)
        worst = max(certify.check(config, replace(library, own_turbulence=config.task.turbulent)))
        print(f"{path.name} {split:10}: {len(library)} targets, worst distance {100 * worst:.2f} % of the diagonal")
        if worst >= certify.MAX_DRIFT:
            sys.exit(f"error: a witness of {path} does not reach its target")


def _check_folder(output: Path) -> None:
    """End the command, before any work, if its results could not be written."""
    try:
        check_folder("output", output)
    except ValueError as error:
        sys.exit(f"error: {error}")


def speed(output: Path = Path("runs/speed"), quick: bool = False) -> None:
    """Measure the simulator's speed beside a plain Numba flag.

    Args:
        output: folder for speed.json and speed.png.
        quick: fewer repetitions.
    """
    from flag_env.studies.speed import run

    _check_folder(output)
    run(output, quick)


def effects(output: Path = Path("runs/effects"), quick: bool = False) -> None:
    """Measure what each effect costs in its scene, and how fast scenes start.

    Args:
        output: folder for effects.json and effects.png.
        quick: fewer repetitions, one start.
    """
    from flag_env.studies.effects import run

    _check_folder(output)
    run(output, quick)


def flutter(output: Path = Path("runs/flutter"), quick: bool = False) -> None:
    """Measure from which wind on a flag flutters, beside linear theory.

    Args:
        output: folder for flutter.json and flutter.png.
        quick: a coarser flag and fewer winds.
    """
    from flag_env.studies.flutter import run

    _check_folder(output)
    run(output, quick)


def gradients(output: Path = Path("runs/gradients"), quick: bool = False) -> None:
    """Measure what gradients through the simulator cost, and how long they stay useful.

    Args:
        output: folder for gradients.json and gradients.png.
        quick: shorter runs, fewer repetitions.
    """
    from flag_env.studies.gradients import run

    _check_folder(output)
    run(output, quick)


def stability(output: Path = Path("runs/stability"), quick: bool = False) -> None:
    """Map which timesteps keep a flag stable, beside the limit that is known before it runs.

    Args:
        output: folder for stability.json and stability.png.
        quick: coarser maps and fewer random scenes.
    """
    from flag_env.studies.stability import run

    _check_folder(output)
    run(output, quick)


def record(
    scene: str = "all",
    output: Path = Path("runs/scenes"),
    seconds: float = 3.0,
    witness: int | None = None,
    agent: Path | None = None,
    control: str = "wind",
    level: str = "breeze",
    target: int = 0,
    quick: bool = False,
) -> None:
    """Record a scene, a witness or an agent as a replay that opens in any browser, or every preset scene.

    Args:
        scene: name of a scene of the live page, such as flag, storm or report-2; all: every one, and a gallery.
        output: file to write, .html, .gif or .mp4; with "all" a folder for a replay and a GIF of each scene, and gallery.png.
        seconds: length of a scene.
        witness: number of a target of the test split, whose witness is recorded instead of a scene.
        agent: folder of a training, whose agent is recorded instead of a scene.
        control: control of the witness.
        level: level of the witness.
        target: number of the agent's target.
        quick: with "all" the gallery alone.
    """
    if scene == "all" and witness is None and agent is None:
        from flag_env.studies.gallery import run

        _check_folder(output)
        run(output, quick)
        return
    from flag_env.viewer import STAGES, Task, of_episode, of_stage, save

    if agent is not None:
        task, act = _agent(agent)
        motion = of_episode(task, "agent", target, act)
    elif witness is not None:
        try:
            motion = of_episode(Task(control, level), "witness", witness)
        except ValueError as error:
            sys.exit(f"error: {error}")
    elif scene in STAGES:
        motion = of_stage(scene, seconds)
    else:
        sys.exit(f"scene must be one of all, {', '.join(STAGES)}, got {scene!r}")
    name = "agent" if agent is not None else scene if witness is None else f"witness-{witness}"
    path = output if output.suffix else output / f"{name}.html"
    path.parent.mkdir(parents=True, exist_ok=True)
    print(save(motion, path))


def play(
    scene: str = "flag",
    witness: int | None = None,
    agent: Path | None = None,
    control: str = "wind",
    level: str = "breeze",
    target: int = 0,
    port: int | None = None,
    browser: bool = True,
) -> None:
    """Fly a flag in the browser: move sliders and the mast while it flies, or watch and play the environment's episodes.

    Args:
        scene: name of the scene that flies first, such as flag, two-layer, storm, rope, sheet, report-1, report-2.
        witness: number of a target of the test split, whose witness is watched first.
        agent: folder of a training, whose agent is watched first.
        control: control of the task.
        level: level of the task.
        target: number of the target that is watched first.
        port: of this machine; 0: any free one. Not given: 8400, or any free one if that is taken.
        browser: open the page in a browser.
    """
    from flag_env.viewer import STAGES, Session, Task
    from flag_env.viewer import play as serve

    if scene not in STAGES:
        sys.exit(f"scene must be one of {', '.join(STAGES)}, got {scene!r}")
    given, watch = _agent(agent) if agent is not None else None, None
    if given is not None:
        watch = "agent", target
    elif witness is not None:
        watch = "witness", witness
    try:
        task, act = given or (Task(control, level), None)
        serve(Session(scene, task, act, watch), port, browser)
    except (ImportError, OSError, ValueError) as error:
        sys.exit(str(error))


def _agent(folder: Path) -> tuple[Task, Act]:
    """Task and agent of a training's folder; end the command if there is none, or nothing to run it."""
    try:
        from training.record import watched  # above this package but for its commands
    except ImportError as error:
        sys.exit(f'an agent needs the extra "training": pip install -e ".[training]" ({error})')
    try:
        return watched(folder)
    except (FileNotFoundError, ValueError) as error:
        sys.exit(f"error: {error}")


def accuracy(output: Path = Path("runs/accuracy"), quick: bool = False) -> None:
    """Measure what accuracy costs in time: integrators, timesteps, dtypes, lattices, and how far a pose can be foretold.

    Args:
        output: folder for accuracy.json and accuracy.png; a run that was stopped goes on there.
        quick: fewer timesteps, lattices and seconds.
    """
    from flag_env.studies.accuracy import run

    _check_folder(output)
    run(output, quick)


def difficulty(
    output: Path | None = None,
    only: tuple[str, ...] = (),
    targets: int = 128,
    planned: int = 16,
    ppo: bool = True,
    quick: bool = False,
) -> None:
    """Measure how hard every level is: baselines, look-ups, planners, witnesses and PPO; a run that was stopped goes on.

    Args:
        output: JSON file; difficulty.json of the checkout's results if not given.
        only: control/level of the rungs to measure, such as wind/wave; none: all.
        targets: test targets of each policy.
        planned: test targets of the planners.
        ppo: train PPO too.
        quick: eight targets, two of the planners, no training.
    """
    try:
        from training import difficulty as measured  # above this package but for its commands
    except ImportError as error:
        sys.exit(f'the difficulty of tasks needs the extra "training": pip install -e ".[training]" ({error})')
    try:
        given = measured.Difficulty(output or measured.RESULTS, only, targets, planned, ppo, quick)
    except (TypeError, ValueError) as error:
        sys.exit(f"error: {error}")
    measured.measure(given)
    print(given.output)


def main() -> None:
    """Run a subcommand."""
    try:
        import tyro
    except ImportError:
        sys.exit('the flag-env command needs the extra "cli": pip install -e ".[cli]"')
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended by a signal"))  # so that what is half made is removed
    tyro.extras.subcommand_cli_from_dict(
        {
            "accuracy": accuracy,
            "difficulty": difficulty,
            "effects": effects,
            "flutter": flutter,
            "gradients": gradients,
            "play": play,
            "record": record,
            "speed": speed,
            "stability": stability,
            "targets": targets,
        },
        description="Studies and tools of flag_env.",
    )
