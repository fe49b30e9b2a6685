"""A step above the limit is refused by the name of what sets the limit."""

import math

import numpy as np
import pytest

from flag_env.physics import Simulator, max_timestep, presets
from flag_env.physics.effects import AirDrag, Bending, Shear, Structural
from flag_env.physics.integrators import LFAB, RK4, ExplicitEuler, Leapfrog, Strang
from flag_env.physics.limits.spectrum import SceneSpectrum
from flag_env.physics.limits.step_limit import limited_by
from tests.physics.test_stability import chain, random_scene


def test_a_step_above_the_limit_is_refused_by_name():
    limit = max_timestep(chain(4))
    Simulator(chain(4, timestep=limit))
    scene = chain(4, timestep=1.001 * limit)
    with pytest.raises(ValueError, match="timestep must not exceed") as caught:
        Simulator(scene)
    assert f"{limit:.6g}" in str(caught.value)
    assert f"{1.001 * limit:.6g}" in str(caught.value)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        (Structural(3e4, 0.01), "the stiffness of Structural"),
        (Shear(3e4, 0.01), "the stiffness of Shear"),
        (Bending(10.0, 9.0), "the damping of Bending"),
        (AirDrag(1e5), "the damping of AirDrag"),
    ],
)
def test_a_refusal_names_what_sets_the_limit(changed, named):
    scene = presets.flag(4, 5).adding(changed)
    for method in (Leapfrog(), LFAB(), RK4(), ExplicitEuler()):
        one = scene.replace(integrator=method, timestep=2 * max_timestep(scene.replace(integrator=method)))
        if not (isinstance(method, ExplicitEuler) and "stiffness" not in named):
            with pytest.raises(ValueError, match=f"set by {named}.*lower {named}"):
                Simulator(one)


def test_a_refused_scaling_names_what_sets_the_limit():
    with pytest.raises(ValueError, match=r"set by the stiffness of Structural; scale it less"):
        Simulator(presets.flag(4, 5).scaled(viscosity=0.0)).set_parameters(30.0)


def test_what_sets_the_limit_has_the_largest_share_of_the_top_mode():
    """v' K_e v, from the eigenvector itself."""
    for seed in range(6):
        scene = random_scene(np.random.default_rng(seed)).replace(integrator=Strang())
        spectrum = SceneSpectrum(scene.lattice, scene.effects)
        values, vectors = np.linalg.eigh(spectrum.stiffness.toarray())
        shares = {}
        for effect in scene.effects:
            alone = SceneSpectrum(scene.lattice, (effect,)).stiffness.toarray()
            shares[f"the stiffness of {type(effect).__name__}"] = vectors[:, -1] @ alone @ vectors[:, -1]
        assert sum(shares.values()) == pytest.approx(values[-1], rel=1e-9)
        assert limited_by(scene) == max(shares, key=shares.get)


def test_an_undamped_scene_has_a_limit_for_every_method():
    """No damping at all on a lattice large enough for Lanczos."""
    scene = presets.flag(8, 10, viscosity=0.0, drag=0.0)
    explicit = max_timestep(scene.replace(integrator=Strang()))
    assert max_timestep(scene.replace(integrator=RK4())) == pytest.approx(math.sqrt(2) * explicit, rel=1e-9)


def test_automatic_step_is_nine_tenths_of_the_limit():
    scene = presets.flag(5, 6)
    assert Simulator(scene).timestep == pytest.approx(0.9 * max_timestep(scene), rel=1e-15)
