"""A run is never overwritten in silence, nor resumed as another one."""

import pytest

from training import hyperparameters
from training.run_folder import claimed


@pytest.fixture
def made(tiny):
    """Arguments of a run whose folder is there, and a function that prepares it again with changes."""

    def again(**changed):
        arguments = tiny(**changed)
        hyper = hyperparameters.read(arguments.hyperparameters, arguments.env_id, arguments.total_timesteps, arguments.n_envs)
        with claimed(arguments.folder, arguments, hyper):
            return arguments

    (again().folder / "model.zip").write_bytes(b"precious")
    return again


def test_a_run_is_not_overwritten(made, tiny):
    with pytest.raises(ValueError, match="--resume or replace it with --overwrite"):
        made()
    assert (tiny().folder / "model.zip").read_bytes() == b"precious"


def test_overwrite_removes_the_old_run(made):
    assert {path.name for path in made(overwrite=True).folder.iterdir()} == {"arguments.json", ".lock"}


def test_a_folder_that_holds_no_run_is_never_removed(made, tiny):
    (tiny().folder / "arguments.json").unlink()
    with pytest.raises(ValueError, match="remove it yourself"):
        made(overwrite=True)


def test_resume_keeps_the_run(made):
    assert (made(resume=True).folder / "model.zip").exists()


@pytest.mark.parametrize("changed", [{"validations": 3}, {"total_timesteps": 99}, {"n_envs": 3}])
def test_resume_refuses_other_arguments(made, changed):
    with pytest.raises(ValueError, match=f"other values of {next(iter(changed))}"):
        made(resume=True, **changed)


def test_resume_and_overwrite_exclude_each_other(made):
    with pytest.raises(ValueError, match="exclude each other"):
        made(resume=True, overwrite=True)


def test_each_task_has_a_folder_of_its_own(tiny):
    names = {tiny(control=control, level=level).folder.name for control in ("wind", "mast") for level in ("calm", "breeze")}
    assert len(names) == 4
    assert "Flag-v0-ppo-0" in names
    assert "Flag-v0-mast-calm-ppo-0" in names


def test_a_run_killed_while_it_described_itself_starts_anew(tiny):
    arguments = tiny(resume=True)
    arguments.folder.mkdir(parents=True)
    (arguments.folder / ".arguments-123.json").write_text("{")
    with claimed(arguments.folder, arguments, hyperparameters.read(arguments.hyperparameters, arguments.env_id)):
        assert {path.name for path in arguments.folder.iterdir()} == {"arguments.json", ".lock"}
