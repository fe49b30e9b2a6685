"""What all tests share: a clean Python process to run a script in, and a record of what the long forms measure."""

import json
import os
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
    from flag_env.studies.report import machine

    known = json.loads(FIGURES.read_text())["cases"] if FIGURES.exists() else {}
    here = {name: machine()[name] for name in ("processor", "date")}
    known |= {name: {**figures, **here} for name, figures in _measured.items()}
    FIGURES.parent.mkdir(exist_ok=True)
    FIGURES.write_text(json.dumps({"machine": machine(), "cases": dict(sorted(known.items()))}, indent=1) + "\n")
