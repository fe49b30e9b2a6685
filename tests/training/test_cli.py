"""`flag-train` runs the training scripts."""

import sys

import pytest

from tests.conftest import ROOT
from training.cli import SCRIPTS, main

pytestmark = pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")  # other tests have imported the scripts


def run(monkeypatch, capsys, *words):
    monkeypatch.setattr(sys, "argv", ["flag-train", *words])
    code = 0
    try:
        main()
    except SystemExit as left:
        code = left.code
    return code, capsys.readouterr().out


def test_every_script_with_a_command_line_has_a_name(monkeypatch, capsys):
    scripts = {path.stem for path in (ROOT / "training").glob("*.py") if '__name__ == "__main__"' in path.read_text()}
    assert set(SCRIPTS.values()) == scripts
    code, told = run(monkeypatch, capsys)
    assert code == 0
    assert all(f"\n  {name} " in told for name in SCRIPTS)


def test_a_subcommand_takes_its_scripts_options(monkeypatch, capsys):
    code, told = run(monkeypatch, capsys, "evaluate", "--help")
    assert code == 0
    assert "--baselines" in told


def test_an_unknown_subcommand_is_refused(monkeypatch, capsys):
    code, _ = run(monkeypatch, capsys, "fly")
    assert code == f"COMMAND must be one of {', '.join(SCRIPTS)}, got 'fly'"
