"""A training that is killed at random moments, again and again, always resumes, and ends as if nothing had happened."""

import pickle
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.training.test_train import assert_same_run
from training.train import run

SCRIPT = """
import pickle, sys
from pathlib import Path
from training.train import run
run(pickle.loads(Path(sys.argv[1]).read_bytes()))
"""


@pytest.mark.slow
@pytest.mark.linux
def test_twenty_kills(tiny, tmp_path, record_property):
    whole, broken = tiny(output="whole", total_timesteps=12_800), tiny(output="broken", total_timesteps=12_800, resume=True)
    run(whole)
    (tmp_path / "arguments.pickle").write_bytes(pickle.dumps(broken))
    random, kills = np.random.default_rng(0), 0
    while kills < 20:
        process = subprocess.Popen(
            [sys.executable, "-c", SCRIPT, str(tmp_path / "arguments.pickle")],
            cwd=Path(__file__).parents[2],
            stderr=subprocess.PIPE,
        )
        if (broken.folder / "checkpoints").exists():
            time.sleep(random.uniform(0.0, 9.0))
        else:
            time.sleep(12.0)
        process.kill()
        errors = process.communicate()[1].decode()
        assert process.returncode in (-9, 0), errors
        if process.returncode == 0:  # it came to its end first: once more from the start
            broken = tiny(output=f"broken-{kills}", total_timesteps=12_800, resume=True)
            (tmp_path / "arguments.pickle").write_bytes(pickle.dumps(broken))
            continue
        kills += 1
    run(broken)
    record_property("kills", kills)
    assert_same_run(whole.folder, broken.folder)
