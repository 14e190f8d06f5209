"""Generic model: what is no parameter and no motion is refused in a sentence."""

from dataclasses import replace

import numpy as np
import pytest

from plant_sim.friction.asperities import Asperities, StickTimeFriction
from plant_sim.friction.counter_surface import CounterSurface, FlatSurface
from plant_sim.friction.generic import DynamicGenericModel, FixedSeparationModel, GenericModel
from protocols.errors import InputError
from tests.plant_sim.friction.test_asperities import (
    AGEING,
    DT,
    LOAD,
    SINE,
    make_asperities,
    make_stepped_model,
    make_surface,
)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: StickTimeFriction(0.0, 0.4, 1.0), r"mu_0 is 0; allowed is a number above 0"),
        (lambda: StickTimeFriction(0.3, 0.2, 1.0), r"mu_inf is 0\.2; allowed is a number at least 0\.3"),
        (lambda: StickTimeFriction(0.2, 0.4, 0.0), r"tau_t is 0 s; allowed is a number above 0"),
        (lambda: CounterSurface(np.ones(2), np.ones(3)), "surface has 2 steps and 3 recesses"),
        (lambda: CounterSurface.draw(0, np.random.default_rng(0)), "number of steps is 0"),
        (lambda: Asperities(np.zeros(2), np.zeros(2), np.array([1.0, 0.0])), "tangential stiffness of element 2 is 0"),
        (lambda: Asperities(np.zeros(2), np.zeros(3), np.ones(2)), r"asperities have 2, 3, 2, 2 positions, heights"),
        (lambda: Asperities(np.zeros(1), np.zeros(1), np.ones(1), mass=-1.0), "asperity mass is -1"),
        (lambda: DynamicGenericModel(make_asperities(), make_surface(), AGEING, -1.0, 0.0), "mass of the body is -1"),
        (lambda: FixedSeparationModel(make_asperities(), make_surface(), AGEING, np.nan), "separation is nan"),
        (lambda: GenericModel("x", make_surface(), AGEING), "asperities is 'x'"),  # type: ignore[arg-type]
        (lambda: GenericModel(make_asperities(), None, AGEING), "counter surface is None"),  # type: ignore[arg-type]
        (lambda: FixedSeparationModel(make_asperities(), make_surface(), 0.2, 0.9), "is 0.2"),  # type: ignore[arg-type]
        (lambda: Asperities.draw(2.5, np.random.default_rng(0)), "number of asperities is 2.5; allowed is a whole"),  # type: ignore[arg-type]
        (lambda: make_stepped_model(count=5).rest(-1.0), "load is -1; allowed is a number at least 0"),
        (lambda: make_stepped_model(count=5).steady_state("a"), "velocity is 'a'"),  # type: ignore[arg-type]
        (lambda: make_stepped_model().observe(SINE, 0.0), "time step is 0 s"),
        (lambda: make_stepped_model().observe(SINE, DT, -1.0), "load"),
    ],
)
def test_bad_values_are_named(make: object, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        make()  # type: ignore[operator]


@pytest.mark.parametrize("surface_", [FlatSurface(), make_surface()], ids=["flat", "steps"])
def test_a_sample_that_would_take_for_ever_is_refused(surface_: CounterSurface | FlatSurface) -> None:
    """The longest displacement is made, in its many parts; a longer one is refused, however it is asked for."""
    model = GenericModel(make_asperities(5, mass=0.01), surface_, AGEING)
    longest = model.longest
    assert np.isfinite(model.observe([0.0, longest], DT, LOAD).force).all()
    for far in (1.01 * longest, 1e18, 1e300):
        for ask in (
            lambda far=far: model.observe([0.0, far], DT, LOAD),
            lambda far=far: model.trace([far, 0.0], DT, LOAD),
            lambda far=far: model.step(model.rest(LOAD), far, DT, LOAD),
        ):
            with pytest.raises(InputError, match=f"displacement.* at most {longest:g}".replace("+", r"\+")):
                ask()
    with pytest.raises(InputError, match="farthest asperity is"):
        GenericModel(replace(model.asperities, position=np.full(5, 1.01 * longest)), surface_, AGEING)


@pytest.mark.parametrize("kind", ["observe", "trace"])
@pytest.mark.parametrize(
    ("position", "options", "sentence"),
    [
        ([], {}, "position has shape (0,)"),
        ([[0.0, 1.0]], {}, "position has shape (1, 2)"),
        (0.0, {}, "position has shape ()"),
        (["a", "b"], {}, "allowed are numbers"),
        ([0.0, np.nan], {}, "holds nan; allowed are finite numbers"),
        ([0.0, 0.1], {"load": [1.0, 1.0, 1.0]}, "load has shape (3,)"),
        ([0.0, 0.1], {"load": -1.0}, "least load is -1"),
        ([0.0, 0.1], {"load": np.nan}, "holds nan"),
        ([0.0, 0.1], {"state": np.zeros(3)}, "state has shape (3,)"),
    ],
)
def test_what_is_no_motion_is_refused(kind: str, position: object, options: dict, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        getattr(make_stepped_model(count=5), kind)(position, DT, **options)
    assert sentence in str(caught.value)
