"""The look for numbers that are not finite cannot be fooled: not by flags that let the compiler assume that all are finite."""

from dataclasses import dataclass
from types import FunctionType
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from flag_env.physics import Diverged, Simulator, presets
from flag_env.physics.compiling import step
from flag_env.physics.effects import Effect, LinearBound

BAD = [np.nan, -np.nan, np.inf, -np.inf]


def fast(dispatcher, **calls):
    """The same function compiled with every fast-math flag, calling others of that kind."""
    source = dispatcher.py_func
    return numba.njit(fastmath=True)(FunctionType(source.__code__, {**source.__globals__, **calls}))


@pytest.fixture(scope="module")
def fast_check():
    count = fast(step._count_non_finite)
    return fast(step.first_non_finite, _non_finite=fast(step._non_finite, _count_non_finite=count))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("compiled", ["as shipped", "with fast-math"])
def test_the_first_bad_number_is_found(fast_check, compiled, dtype):
    check = fast_check if compiled == "with fast-math" else step.first_non_finite
    largest = np.finfo(dtype).max
    for bad in BAD:
        for d in range(3):
            for particle in (0, 17, 100):
                for which in range(2):
                    arrays = np.full((3, 101), largest, dtype), np.full((3, 101), -largest, dtype)
                    arrays[0][2, 3] = np.finfo(dtype).smallest_subnormal
                    assert check(*arrays) == -1
                    arrays[which][d, particle] = bad
                    arrays[1 - which][1, 100] = bad
                    assert check(*arrays) == particle


@numba.njit(fastmath=True, error_model="numpy")
def _push(data, copy, x, v, f, effect_work, lag):
    f[0, 20] += 1e-9 * np.sqrt(60.0 - data.phase[copy])


@numba.njit(fastmath=True, error_model="numpy")
def _count(data, copy, seconds):
    data.phase[copy] += 1.0


class PoisonData(NamedTuple):
    phase: Any

    force = staticmethod(_push)
    advance = staticmethod(_count)


@dataclass(frozen=True)
class Poison(Effect):
    """A force that is NaN from step 62 on, compiled with every fast-math flag."""

    def bind(self, context):
        return PoisonData(np.zeros(context.copies))

    def linear_bound(self, lattice):
        return LinearBound()


def test_a_bad_number_out_of_fast_math_is_named_within_a_hundred_steps():
    scene = presets.flag(6, 7).adding(Poison())
    sim = Simulator(scene, copies=2)
    sim.step(61)
    assert np.isfinite(sim.positions).all()
    with pytest.raises(Diverged) as caught:
        sim.step(400)
    assert 61 < caught.value.time / sim.timestep <= 161 + 1e-6
    assert sim.diverged.all()
