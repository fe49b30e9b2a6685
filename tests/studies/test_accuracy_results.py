"""The committed results of the accuracy study: what it measured, and that the presets are chosen by it."""

import json

import pytest

from flag_env.physics.accuracy.tuning import ACCURACIES
from flag_env.studies import work_precision
from flag_env.studies.accuracy_scenes import ENVIRONMENT, METHODS
from flag_env.studies.work_precision import DTYPES, ERROR, LESS, SECONDS, SHARES
from tests.conftest import ROOT

RECORD = json.loads((ROOT / "flag_env/studies/results/accuracy.json").read_text())
KEYS = ("lattice", "method", "dtype", "share of limit")


def points(scene=ENVIRONMENT):
    return [row for row in RECORD["rows"] if row["scene"] == scene]


def preset(name, scene=ENVIRONMENT):
    return next(row for row in points(scene) if row["preset"] and row["method"] == name)


def test_every_method_timestep_and_dtype_was_measured_on_the_flag_of_the_environments():
    measured = {(row["method"], row["dtype"], row["share of limit"]) for row in points() if row["lattice"] == "16 x 10"}
    assert measured >= {(method, dtype, share) for method in METHODS for dtype in DTYPES for share in SHARES}


@pytest.mark.parametrize("name", ACCURACIES)
def test_no_measured_point_is_both_quicker_and_more_accurate_than_a_preset(name):
    chosen = preset(name)
    assert not [row for row in points() if row[SECONDS] <= chosen[SECONDS] and row[ERROR] < LESS * chosen[ERROR]]


@pytest.mark.parametrize(("name", "within"), [("balanced", 1e-4), ("reference", 1e-7)])
def test_a_preset_is_the_quickest_point_of_an_error(name, within):
    quickest = min((row for row in points() if row[ERROR] < within), key=lambda row: row[SECONDS])
    assert quickest["timestep [s]"] == preset(name)["timestep [s]"]
    assert quickest[SECONDS] == preset(name)[SECONDS]


def test_what_is_quicker_than_fast_integrates_worse():
    fast = preset("fast")
    quicker = [row for row in points() if row[SECONDS] < fast[SECONDS]]
    assert all(row["integration alone [m]"] > fast["integration alone [m]"] for row in quicker)


def test_why_the_reference_is_not_in_float32():
    single = {scene: row for scene in RECORD["presets"] for row in points(scene)
              if [row[key] for key in KEYS] == ["16 x 10", "RK4", "float32", 0.9]}  # fmt: skip
    assert single[ENVIRONMENT][ERROR] < 1e-6
    assert single[ENVIRONMENT][SECONDS] < preset("reference")[SECONDS]
    assert min(single[scene][ERROR] for scene in ("calm", "two-layer")) > 1e-6


@pytest.mark.parametrize(("name", "promise"), [("balanced", 1e-3), ("reference", 1e-6)])
def test_presets_keep_their_promises(name, promise):
    kept = [row for row in RECORD["errors"] if row["method"] == name]
    assert len(kept) == len(RECORD["presets"]) == 4
    assert max(error for row in kept for error in row["RMS errors [m]"]) < promise


def test_the_table_of_presets_follows_from_the_points():
    assert RECORD["presets"][ENVIRONMENT] == work_precision.summary(points())


def test_gain_over_the_reports_scheme():
    assert RECORD["gain"] > 300


def test_round_off_is_cheapest_met_by_the_method_of_the_reference():
    for scene in RECORD["presets"]:
        fine = [row for row in work_precision.front(points(scene)) if row[ERROR] < 1e-9 and not row["preset"]]
        assert {(row["method"], row["dtype"]) for row in fine} == {("RK4", "float64")}


def test_methods_agree_on_averages_past_the_horizon():
    assert {row["scene"] for row in RECORD["averages"]} == {"gusty"}
    assert all(row["from [s]"] >= RECORD["growth"]["gusty"]["horizon"] for row in RECORD["averages"])
    assert all(row["agrees"] for row in RECORD["averages"])
