"""Iron: Jiles-Atherton hysteresis driven by the flux density, and single-valued curves."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.constants import mu_0
from scipy.integrate import trapezoid
from scipy.special import ive

from amb_core.ground.errors import PlantError
from amb_core.plant.iron import anhysteretic_field, initial_iron, pack_curve, pack_material, saturation_curve
from amb_core.plant.kernel.iron import advance_hysteresis, follow_curve
from amb_core.plant.kernel.langevin import ASYMPTOTE_FROM, langevin
from amb_core.plant.kernel.records import ELEMENTS
from amb_core.plant.parameters import IronParameters


def steel(**changes: float) -> IronParameters:
    published = {
        "saturation_magnetisation": 1_145_220.0,
        "anhysteretic_field": 59.5,
        "interdomain_coupling": 1.3e-4,
        "pinning_field": 99.2,
        "reversibility": 0.54,
    }
    return IronParameters(saturation=True, hysteresis=True, **(published | changes))


def cycles(peak: float, steps: int, number: int = 1, bias: float = 0.0) -> np.ndarray:
    """Flux density from `bias` up to `bias + peak`, then triangles between `bias + peak` and `bias - peak`."""
    corners = [0.0, *[1.0, -1.0] * number, 1.0]
    legs = [
        np.linspace(start, stop, round(abs(stop - start) * steps / 4), endpoint=False)
        for start, stop in itertools.pairwise(corners)
    ]
    return bias + peak * np.concatenate([*legs, [1.0]])


def follow(parameters: IronParameters, path: np.ndarray, iron: np.void | None = None) -> tuple[np.ndarray, np.void]:
    """Fields along flux densities, shape (n,) for all elements alike or (n, 24), and the iron at the end."""
    paths = np.broadcast_to(path.reshape(len(path), -1), (len(path), ELEMENTS))
    iron = initial_iron(paths[0], parameters) if iron is None else iron
    material = pack_material(parameters)
    fields = np.empty_like(paths)
    for n, flux_density in enumerate(paths):
        iron["target"] = flux_density
        advance_hysteresis(iron, material)
        fields[n] = iron["field"]
    return fields, iron


def area(fields: np.ndarray, path: np.ndarray, steps: int) -> float:
    """Area of the last cycle (J/m^3)."""
    return float(trapezoid(fields[-steps - 1 :], path[-steps - 1 :]))


def test_langevin_function_is_a_ratio_of_bessel_functions():
    x = np.concatenate([np.logspace(-8, 4, 300), np.linspace(0.9, 1.1, 50) * ASYMPTOTE_FROM])
    value, slope = langevin(x)
    expected = ive(1.5, x) / ive(0.5, x)
    np.testing.assert_allclose(value, expected, rtol=2e-11)
    np.testing.assert_allclose(langevin(-x)[0], -value, rtol=0)
    near = x[(x > 0.01) & (x < 20.0)]
    exact = 1.0 / near**2 - 1.0 / np.sinh(near) ** 2
    np.testing.assert_allclose(langevin(near)[1], exact, rtol=1e-8)
    assert np.all(slope > 0.0)


def test_published_steel_has_the_loop_of_a_silicon_steel():
    steps = 2000
    path = cycles(1.3, steps, number=2)
    fields = follow(steel(), path)[0][:, 0]
    falling = slice(-steps - 1, -steps // 2)
    coercivity = -np.interp(0.0, -path[falling], fields[falling])
    remanence = np.interp(0.0, -fields[falling], path[falling])
    assert coercivity == pytest.approx(36.0, abs=0.1)
    assert remanence == pytest.approx(0.674, abs=1e-3)
    assert area(fields, path, steps) == pytest.approx(232.0, abs=0.5)
    permeability = path[1 : steps // 4] / fields[1 : steps // 4] / mu_0
    assert 6000 < permeability[0] < permeability.max() < 9000


def test_loops_are_odd():
    path = cycles(1.2, 400)
    up, _ = follow(steel(), path)
    down, _ = follow(steel(), -path)
    np.testing.assert_array_equal(up, -down)


def test_constant_flux_density_changes_nothing():
    _, iron = follow(steel(), cycles(1.0, 400))
    before = iron.copy()
    advance_hysteresis(iron, pack_material(steel()))
    for name in ("flux_density", "magnetisation", "slope", "field", "work"):
        np.testing.assert_array_equal(iron[name], before[name])


def test_every_element_gives_the_same_bits_wherever_it_stands():
    path = np.linspace(0.1, 1.6, ELEMENTS) * cycles(1.0, 400)[:, None]
    fields, _ = follow(steel(), path)
    order = np.random.default_rng(0).permutation(ELEMENTS)
    permuted, _ = follow(steel(), path[:, order])
    np.testing.assert_array_equal(permuted, fields[:, order])


def test_second_order_between_reversals():
    coarse, middle, fine = (follow(steel(), np.linspace(0.0, 1.2, steps + 1))[0][-1, 0] for steps in (200, 400, 800))
    assert np.log2((coarse - middle) / (middle - fine)) == pytest.approx(2.0, abs=0.1)


def test_work_over_a_closed_loop_is_its_area():
    steps, path = 1000, cycles(1.0, 1000, number=3)
    fields, iron = follow(steel(), path)
    _, halfway = follow(steel(), path[:-steps])
    work = iron["work"] - halfway["work"]
    np.testing.assert_allclose(work, area(fields[:, 0], path, steps), rtol=1e-9)


def test_minor_loops_settle_and_lie_inside_the_major_loop():
    material = steel()
    _, iron = follow(material, cycles(1.3, 1000))
    minor = cycles(0.05, 200, number=60, bias=0.5)
    fields, _ = follow(material, np.concatenate([np.linspace(1.3, 0.5, 400), minor]), iron)
    at_top = fields[-60 * 200 - 1 :: 200, 0]
    assert abs(at_top[-1] - at_top[-2]) < 0.01
    loss = [area(fields[: len(fields) - 200 * back, 0], minor[: len(minor) - 200 * back], 200) for back in (0, 1)]
    assert 0.0 < loss[0] < 5.0
    assert loss[0] == pytest.approx(loss[1], rel=1e-2)


@pytest.mark.parametrize("changes", [{"reversibility": 1.0}, {"pinning_field": 0.1}])
def test_without_pinning_or_all_reversible_the_iron_follows_its_anhysteretic_curve(changes):
    path = cycles(1.2, 8000)
    fields, _ = follow(steel(**changes), path)
    expected = saturation_curve(steel()).field(path)
    np.testing.assert_allclose(fields[:, 0], expected, atol=1.0)  # A/m; the steel itself lags 36 A/m behind


def test_saturates():
    path = np.linspace(0.0, 3.0, 3001)
    fields, iron = follow(steel(), path)
    assert np.all(np.diff(fields[:, 0]) > 0.0)
    assert (fields[-1, 0] - fields[-100, 0]) / (path[-1] - path[-100]) * mu_0 == pytest.approx(1.0, abs=1e-4)
    assert iron["magnetisation"][0] == pytest.approx(1_145_220.0, rel=1e-3)


@settings(max_examples=30, deadline=None)
@given(
    saturation=st.floats(5e5, 2e6),
    a=st.floats(10.0, 2000.0),
    feedback=st.floats(0.0, 0.95),
    pinning=st.floats(5.0, 500.0),
    reversibility=st.floats(0.0, 1.0),
    part=st.floats(0.05, 0.9),
)
def test_loops_lose_energy_whatever_the_material(saturation, a, feedback, pinning, reversibility, part):
    parameters = steel(
        saturation_magnetisation=saturation,
        anhysteretic_field=a,
        interdomain_coupling=3.0 * a / saturation * feedback,
        pinning_field=pinning,
        reversibility=reversibility,
    )
    coarse, fine = (
        area(follow(parameters, path)[0][:, 0], path, steps)
        for steps in (1000, 2000)
        for path in [cycles(part * mu_0 * saturation, steps, number=2)]
    )
    # Fully reversible iron loses nothing; then the area is the error of the step, four thirds of the difference.
    assert coarse >= -2.0 * abs(coarse - fine) - 1e-9 * saturation * mu_0 * parameters.anhysteretic_field


@settings(max_examples=30, deadline=None)
@given(st.lists(st.sampled_from([0.0, 1e-9, -1e-9, 0.1, -0.1, 0.03]), min_size=1, max_size=100))
def test_jumps_and_rests_leave_the_state_finite(jumps):
    path = np.clip(np.cumsum(jumps), -3.0, 3.0)
    fields, iron = follow(steel(), np.concatenate([[0.0], path]))
    assert all(np.all(np.isfinite(iron[name])) for name in iron.dtype.names)
    assert np.all(iron["slope"] >= 0.0)
    assert np.abs(iron["magnetisation"][0]) < 1.1 * 1_145_220.0
    np.testing.assert_allclose(fields[-1], path[-1] / mu_0 - iron["magnetisation"], atol=1e-6)


def test_anhysteretic_field_solves_its_equations():
    parameters = steel()
    flux_density = np.concatenate([[1e-12, 1e-4], np.linspace(-2.5, 2.5, 101)])
    field, reluctivity = anhysteretic_field(flux_density, parameters)
    magnetisation = flux_density / mu_0 - field
    argument = (field + 1.3e-4 * magnetisation) / 59.5
    np.testing.assert_allclose(magnetisation, 1_145_220.0 * langevin(argument)[0], rtol=1e-10, atol=1e-9)
    step = 1e-6
    ahead, behind = (anhysteretic_field(flux_density + side * step, parameters)[0] for side in (1.0, -1.0))
    np.testing.assert_allclose(reluctivity, (ahead - behind) / (2.0 * step), rtol=1e-5)


def test_curve_reproduces_the_anhysteretic_field_and_its_slope():
    curve = saturation_curve(steel())
    flux_density = np.random.default_rng(0).uniform(-2.8, 2.8, 1000)
    field, reluctivity = anhysteretic_field(flux_density, steel())
    np.testing.assert_allclose(curve.field(flux_density), field, rtol=1e-6)
    np.testing.assert_allclose(curve.differential_reluctivity(flux_density), reluctivity, rtol=1e-4)
    assert curve.field(np.zeros(1)) == 0.0
    beyond = curve.end + np.array([0.0, 1.0])
    assert np.diff(curve.field(beyond)) == pytest.approx(1.0 / mu_0, rel=1e-12)


def test_kernel_follows_the_curve():
    parameters = IronParameters(saturation=True)
    iron, curve = initial_iron(np.zeros(ELEMENTS), parameters), pack_curve(parameters)
    for flux_density in (np.linspace(-1.9, 1.9, ELEMENTS), np.linspace(0.3, 4.0, ELEMENTS)):
        iron["target"] = flux_density
        follow_curve(iron, curve)
    expected = saturation_curve(parameters)
    np.testing.assert_allclose(iron["field"], expected.field(flux_density), rtol=1e-12)
    np.testing.assert_allclose(
        iron["slope"], 1.0 / mu_0 - expected.differential_reluctivity(flux_density), rtol=1e-12, atol=1e-3
    )
    np.testing.assert_array_equal(iron["flux_density"], flux_density)
    np.testing.assert_allclose(iron["magnetisation"], flux_density / mu_0 - iron["field"], atol=1e-6)


def test_work_along_a_curve_comes_back():
    parameters = IronParameters(saturation=True)
    iron, curve = initial_iron(np.zeros(ELEMENTS), parameters), pack_curve(parameters)
    for flux_density in np.concatenate([cycles(1.4, 400), np.linspace(1.4, 0.0, 101)[1:]]):
        iron["target"] = flux_density
        follow_curve(iron, curve)
    np.testing.assert_allclose(iron["work"], 0.0, atol=1e-9)


def test_initial_state_lies_on_the_anhysteretic_curve_and_moves_reversibly():
    flux_density = np.linspace(-1.2, 1.2, ELEMENTS)
    iron = initial_iron(flux_density, steel())
    np.testing.assert_allclose(iron["field"], anhysteretic_field(flux_density, steel())[0], rtol=1e-7)
    slope = iron["slope"].copy()
    iron["target"] += 1e-9
    advance_hysteresis(iron, pack_material(steel()))
    np.testing.assert_allclose(iron["slope"], slope, rtol=1e-4)


@pytest.mark.parametrize("use", [pack_material, saturation_curve])
def test_self_magnetising_parameters_are_refused(use):
    with pytest.raises(PlantError, match=r"interdomain_coupling = 0.000417 .* allowed: less than 1"):
        use(steel(interdomain_coupling=417e-6, saturation_magnetisation=1.33e6, anhysteretic_field=172.856))


@pytest.fixture
def table(tmp_path):
    def write(text: str):
        path = tmp_path / "steel.csv"
        path.write_text(text)
        return IronParameters(saturation=True, bh_table=str(path))

    return write


def test_table_is_met_in_its_points_and_ends_in_air(table):
    parameters = table("H,B\n# measured\n0,0\n\n50, 0.4\n100,0.9\n300,1.3\n3000,1.6\n30000,1.9\n")
    curve = saturation_curve(parameters)
    flux_density = np.array([0.0, 0.4, 0.9, 1.3, 1.6, 1.9])
    np.testing.assert_allclose(curve.field(flux_density), [0.0, 50, 100, 300, 3000, 30000], rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(curve.field(-flux_density), -curve.field(flux_density))
    assert np.all(curve.differential_reluctivity(np.linspace(0.0, 2.5, 20001)) >= 0.0)
    assert curve.differential_reluctivity(np.array([1.95])) == pytest.approx(1.0 / mu_0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("H,B\n0,0\n50,0.4\n", r"2 points; allowed: 3 or more"),
        ("", r"0 points"),
        ("0,0\n50,0.4,1\n", r"line 2: 3 columns; allowed: two"),
        ("0,0\n50,x\n90,0.9\n", r"line 2: '50,x'; allowed: two numbers"),
        ("1,0\n50,0.4\n90,0.9\n", r"line 1: the curve begins at H = 1 A/m, B = 0 T; allowed: 0, 0"),
        ("H,B\n0,0\n50,0.4\n40,0.5\n", r"line 4: H = 40 A/m, B = 0.5 T after 50 A/m, 0.4 T; allowed: both rise"),
        ("0,0\n50,0.4\n60,0.4\n", r"line 3: .* allowed: both rise"),
        ("0,0\n50,0.4\n60,nan\n", r"line 3: .* allowed: finite"),
        ("0,0\n50,1.4\n1e6,1.5\n", r"line 3: slope dB/dH = 1e-07 H/m; allowed: mu0"),
        ("0,0\n50,1.4\n60,5.5\n", r"line 3: B = 5.5 T; allowed: 5 T or less"),
    ],
)
def test_unusable_tables_are_refused_with_file_and_line(table, text, message):
    with pytest.raises(PlantError, match=rf"steel\.csv.*{message}"):
        saturation_curve(table(text))


def test_missing_table_is_refused():
    with pytest.raises(PlantError, match=r"absent\.csv cannot be read: No such file"):
        saturation_curve(IronParameters(saturation=True, bh_table="absent.csv"))
