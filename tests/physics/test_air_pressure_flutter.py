"""Flutter: its onset, its frequency and its study, against linear theory."""

import json
from pathlib import Path

import pytest

from flag_env.studies import flutter


@pytest.fixture(scope="module")
def fluttering():
    return {row["wind speed (m/s)"]: row for row in flutter.measure(flutter.scene(), (1.0, 3.0, 6.0, 10.0), seconds=16.0)}


def test_a_small_deflection_decays_below_the_onset_and_grows_above_it(fluttering):
    """At the rate and the frequency of linear theory, which knows nothing of particles."""
    assert fluttering[1.0]["growth rate (1/s)"] < -0.02
    assert fluttering[1.0]["theory (Hz)"] > 0.1
    for speed, rate in ((3.0, 0.3), (6.0, 1.9), (10.0, 5.0)):
        row = fluttering[speed]
        assert row["growth rate (1/s)"] > rate
        assert row["growth rate (1/s)"] == pytest.approx(row["theory (1/s)"], rel=0.06)
        assert row["frequency (Hz)"] == pytest.approx(row["theory (Hz)"], rel=0.08)


def test_linear_theory_does_not_depend_on_its_grid():
    """Below the onset, too, where most of the modes do."""
    for speed in (0.75, 1.0, 1.25, 1.5, 2.0, 6.0):
        coarse, fine = (flutter.theory(flutter.scene(20, 32), speed, points) for points in (80, 160))
        assert coarse == pytest.approx(fine, rel=0.02)


def test_the_committed_study_agrees_with_linear_theory_on_either_side_of_the_onset():
    """The decay that was measured with the particles, and where it ends."""
    kept = json.loads((Path(flutter.__file__).parent / "results" / "flutter.json").read_text())
    case = flutter.scene(20, 32)
    for row in kept["rows"]:
        speed, measured = row["wind speed (m/s)"], row["growth rate (1/s)"]
        within = 0.3 if speed < 1.0 else 0.1 if speed < 1.6 else 0.05
        assert measured == pytest.approx(flutter.theory(case, speed).real, rel=within)
        assert row["theory (1/s)"] == pytest.approx(flutter.theory(case, speed).real, rel=1e-9)
    assert kept["onset (m/s)"] == pytest.approx(kept["onset by linear theory (m/s)"], rel=0.01)


def test_above_the_onset_the_tip_has_one_clear_frequency(fluttering):
    assert fluttering[1.0]["tip amplitude (m)"] < 0.02
    for speed in (6.0, 10.0):
        assert fluttering[speed]["share of the peak"] > 0.95
        assert fluttering[speed]["tip amplitude (m)"] > 0.06
        assert 0.03 < fluttering[speed]["Strouhal number"] < 0.3


def test_the_study_writes_its_files(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(flutter, "QUICK", (1.0, 1.2, 4.0))
    monkeypatch.setattr(flutter, "measure", lambda scene, speeds, seconds, measure=flutter.measure: measure(scene, speeds, 4.0))
    flutter.run(tmp_path, quick=True)
    assert {path.name for path in tmp_path.iterdir()} == {"flutter.json", "flutter.png"}
    assert "onset (m/s)" in capsys.readouterr().out
