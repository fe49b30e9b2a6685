"""What all tests share: a clean Python process to run a script in."""

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
