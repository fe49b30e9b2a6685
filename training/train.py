"""Trains an agent: `python -m training.train`.

The folder of a run, `runs/<task>-<algo>-<seed>/`, receives

    model.zip            the agent, for stable-baselines3
    evaluation.json      its success on every target of the validation split, beside that of two policies that do not learn
    learning_curve.json  success on some of them during the training; learning_curve.png shows it
    agent.gif            the agent on four test targets
    arguments.json       arguments, hyperparameters, versions of the packages, machine, earlier totals of an extended run
    tensorboard/         what stable-baselines3 logs
    checkpoints/         the last two; `--resume` goes on from there, to the same bits as without the interruption

One process at a time trains in a folder. A finished run is extended by `--resume` with more `--total-timesteps`: schedules that
fall over the training then stand where the new total puts them, so that it is another training than one of that total from the
start.

A checkpoint is a pickle, and loading one runs code: resume only trainings of your own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import torch
import tyro
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, ProgressBarCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecMonitor

from flag_env import _validate
from flag_env._files import check_folder, read_json, replacing, write_json
from flag_env.control import CONTROLS
from flag_env.physics.accuracy import ACCURACIES
from training import checkpoint, hyperparameters, learning_curve, run_folder
from training.baselines import BASELINES
from training.callbacks import Checkpoints, Validation
from training.environments import Task, learning_envs
from training.evaluate import ALGORITHMS, evaluate, table
from training.record import record, replay
from training.rollouts import Agent

CHECKPOINT_EVERY = {"ppo": 0, "sac": 5_000}
"""Least timesteps between two checkpoints; a replay buffer is too large to be written more often."""

LARGEST_SEED = 2**32 - 1
"""Largest seed that NumPy's global generator takes."""


@dataclass(frozen=True)
class Arguments:
    """Arguments of a training."""

    algo: Literal["ppo", "sac"] = "ppo"
    """Algorithm of stable-baselines3."""
    env_id: str = "Flag-v0"
    """Environment."""
    control: str = "wind"
    """What the agent acts on."""
    level: str = "breeze"
    """Difficulty."""
    accuracy: Literal["fast", "balanced", "reference"] | float = "balanced"
    """Of the simulation: a recipe, or the integration error over one second in metres."""
    seed: int = 0
    """Seed of everything random."""
    total_timesteps: int | None = None
    """Steps of all environments together, rounded up to whole rollouts. None: as in the hyperparameter file."""
    n_envs: int | None = None
    """Number of environments. None: as in the hyperparameter file."""
    hyperparameters: Path | None = None
    """Hyperparameter file in rl-zoo3's format. None: that of the level or the control, or <algo>.yml."""
    device: str = "cpu"
    """Where the networks live; the GPU is slower for networks as small as these."""
    validations: int = 10
    """Points of the learning curve, about."""
    validation_episodes: int = 32
    """Targets that each of these points has an episode of."""
    evaluation_episodes: int | None = None
    """Targets of the evaluation at the end. None: every one of the validation split."""
    record: bool = True
    """Film the agent at the end."""
    progress: bool = True
    """Show a progress bar."""
    output: Path = Path("runs")
    """Where the folder of the run is made."""
    resume: bool = False
    """Go on from the last checkpoint of the same run; a finished one may be given more timesteps. Loading it runs code:
    resume only trainings of your own."""
    overwrite: bool = False
    """Remove what an earlier run left in the folder."""

    def __post_init__(self) -> None:
        _validate.choice("algo", self.algo, ALGORITHMS)
        _validate.choice("control", self.control, CONTROLS)
        sizes = self.task.sizes
        if isinstance(self.accuracy, str):
            _validate.choice("accuracy", self.accuracy, ACCURACIES)
        else:
            _validate.number("accuracy", self.accuracy, above=0.0)
        _validate.count("seed", self.seed, 0, LARGEST_SEED)
        for name in ("total_timesteps", "n_envs"):
            if getattr(self, name) is not None:
                _validate.count(name, getattr(self, name))
        _validate.count("validations", self.validations)
        _validate.count("validation_episodes", self.validation_episodes, 1, sizes["validation"])
        if self.evaluation_episodes is not None:
            _validate.count("evaluation_episodes", self.evaluation_episodes, 1, sizes["validation"])
        if self.resume and self.overwrite:
            raise ValueError("--resume and --overwrite exclude each other")

    @property
    def task(self) -> Task:
        """What is to be learnt."""
        return Task(self.env_id, self.control, self.level, self.accuracy)

    @property
    def folder(self) -> Path:
        """Folder of the run."""
        return self.output / f"{self.task.name}-{self.algo}-{self.seed}"


def start(arguments: Arguments, hyper: hyperparameters.Hyperparameters) -> BaseAlgorithm:
    """A model that has learnt nothing yet, in its environments."""
    envs = VecMonitor(learning_envs(arguments.task, hyper.n_envs, "train"))
    algorithm = ALGORITHMS[arguments.algo]
    try:
        return algorithm(hyper.policy, envs, seed=arguments.seed, device=arguments.device, **hyper.keywords())
    except (AssertionError, AttributeError, RuntimeError, TypeError, ValueError) as error:  # SB3 and PyTorch raise all of these
        raise ValueError(f"hyperparameters and device must suit {arguments.algo} of stable-baselines3: {error}") from error


def run(arguments: Arguments, callbacks: tuple[BaseCallback, ...] = ()) -> dict[str, Any]:
    """Train, or go on with a training, and return the content of `evaluation.json`."""
    torch.set_num_threads(1)  # networks this small gain nothing from more, and sums keep their order
    path = arguments.hyperparameters or hyperparameters.shipped(arguments.algo, arguments.control, arguments.level)
    hyper = hyperparameters.read(path, arguments.env_id, arguments.total_timesteps, arguments.n_envs)
    folder = check_folder("output", arguments.folder)
    run_folder.check(folder, arguments, hyper)
    if arguments.resume and run_folder.finished(folder, hyper.total_timesteps):
        return read_json(folder / "evaluation.json")  # type: ignore[no-any-return]
    # All that may be refused is made before the folder, so that a refusal leaves nothing behind.
    goes_on = arguments.resume and checkpoint.paths(folder / "checkpoints")
    fresh = None if goes_on else start(arguments, hyper)
    with run_folder.claimed(folder, arguments, hyper):
        return _run(arguments, hyper, fresh, callbacks)


def _run(
    arguments: Arguments, hyper: hyperparameters.Hyperparameters, fresh: BaseAlgorithm | None, callbacks: tuple[BaseCallback, ...]
) -> dict[str, Any]:
    """Train a fresh model, or the one of the last checkpoint, in a folder that is held, and return `evaluation.json`."""
    folder, task = arguments.folder, arguments.task
    loaded = checkpoint.load(folder / "checkpoints", ALGORITHMS[arguments.algo], arguments.device) if arguments.resume else None
    model, gathered = loaded or (fresh or start(arguments, hyper), {"curve": [], "seconds": 0.0})
    curve = gathered["curve"]
    every = max(1, hyper.total_timesteps // arguments.validations)
    validation_envs = VecMonitor(learning_envs(task, arguments.validation_episodes, "validation"))
    validation = Validation(validation_envs, every, curve, arguments.task.goal)
    checkpoints = Checkpoints(folder / "checkpoints", CHECKPOINT_EVERY[arguments.algo], curve, gathered["seconds"])
    learn(model, hyper.total_timesteps, [validation, checkpoints, *callbacks], folder, arguments.progress)
    seconds = round(checkpoints.seconds, 1)
    validation_envs.close()

    with replacing(folder / "model.zip") as partial:
        model.save(partial)
    policies = {"agent": Agent(model), **{name: BASELINES[name](task, "validation") for name in ("zero", "random")}}
    result = evaluate(policies, task, "validation", arguments.evaluation_episodes)
    result |= {"timesteps": model.num_timesteps, "seconds": seconds}
    write_json(folder / "learning_curve.json", curve)
    title = f"{task.env_id}, {task.control}, {task.level}: {arguments.algo.upper()}, seed {arguments.seed}"
    baselines = {name: result["policies"][name] for name in ("zero", "random")}
    learning_curve.draw(folder / "learning_curve.png", curve, baselines, title)
    if arguments.record:
        record(folder / "agent.gif", policies["agent"], task)
        replay(folder / "agent.html", policies["agent"], task)
    write_json(folder / "evaluation.json", result)  # last: it marks the run as finished
    return result


def learn(model: BaseAlgorithm, total: int, callbacks: list[BaseCallback], folder: Path, progress: bool) -> None:
    """Train up to `total` timesteps, those of earlier sessions included."""
    if model.num_timesteps >= total:
        return
    bar = ProgressBarCallback() if progress else None
    model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
    try:
        # An unfinished run adds what is missing to what it has: SB3 counts on from num_timesteps.
        model.learn(total - model.num_timesteps, [*callbacks, *([bar] if bar else [])], reset_num_timesteps=False)
    except BaseException:
        if bar is not None and hasattr(bar, "pbar"):
            bar.on_training_end()  # else the terminal stays without a cursor
        raise
    finally:
        model.logger.close()


def main() -> None:
    """Parse the command line, train and tell where everything is."""
    arguments = tyro.cli(Arguments, description=__doc__)
    try:
        result = run(arguments)
    except ValueError as error:
        raise SystemExit(f"error: {error}") from error
    except KeyboardInterrupt:
        raise SystemExit(f"interrupted; go on with the same command and --resume (in {arguments.folder})") from None
    print(table(result))
    print(f"\n{result['timesteps']} steps in {result['seconds']:.0f} s; in {arguments.folder}:")
    for path in sorted(arguments.folder.iterdir()):
        print(f"  {path.name}{'/' if path.is_dir() else ''}")


if __name__ == "__main__":
    main()
