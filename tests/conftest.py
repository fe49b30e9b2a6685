"""What all tests share: a clean Python process to run a script in, and a record of what the long forms measure."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def run_python() -> Callable[..., str]:
    """Function that runs a script in a Python of its own and returns what it prints; fails with its errors."""

    def run(script: str, path: Path = ROOT, **environment: str) -> str:
        result = subprocess.run(
            [sys.executable, "-c", script],
            env={**os.environ, "PYTHONPATH": str(path), **environment},
            cwd=path,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout

    return run


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Leave out what only Linux has."""
    if "linux" in item.keywords and sys.platform != "linux":
        pytest.skip("forks processes, kills them or reads /proc")


UNKNOWN = ("unshare", "--user", "--map-user=4242", "--map-group=4242")
"""Runs a command as a user of a number that the system does not know, and without root's power over permissions."""

HOMELESS = """
import pwd
def _unknown(number): raise KeyError(number)
pwd.getpwuid = _unknown
"""


@pytest.fixture(scope="session")
def run_stranger() -> Callable[..., str]:
    """Function that runs a script as a user without home, name and rights; nothing but the given environment is set."""
    there = shutil.which("unshare") is not None
    apart = there and subprocess.run([*UNKNOWN, "true"], capture_output=True, check=False).returncode == 0

    def run(script: str, path: Path, **environment: str) -> str:
        command = [sys.executable, "-c", script if apart else HOMELESS + script]
        result = subprocess.run(
            [*UNKNOWN, *command] if apart else command,
            env={"PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1", **environment},
            cwd=path,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout + result.stderr

    return run


FIGURES = ROOT / "tests" / "results" / "hard_cases.json"
"""Figures of the last run of the long forms: what each test gave to `record_property`, with date, versions and machine."""

_measured: dict[str, dict[str, object]] = {}


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Keep what a long form has measured."""
    if report.when == "call" and report.passed and "slow" in report.keywords:
        _measured[report.nodeid] = {**dict(report.user_properties), "seconds": round(report.duration, 1)}


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the figures of the long forms that have run over those of earlier runs."""
    if not _measured or hasattr(session.config, "workerinput"):
        return
    from flag_env._files import machine

    known = json.loads(FIGURES.read_text())["cases"] if FIGURES.exists() else {}
    here = {name: machine()[name] for name in ("processor", "date")}
    known |= {name: {**figures, **here} for name, figures in _measured.items()}
    FIGURES.parent.mkdir(exist_ok=True)
    FIGURES.write_text(json.dumps({"machine": machine(), "cases": dict(sorted(known.items()))}, indent=1) + "\n")
