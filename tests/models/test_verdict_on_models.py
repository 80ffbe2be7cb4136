"""Right models are accepted, wrong ones rejected or said to be undecidable, with honest errors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy import stats

from sldvexp.dataset import RunData, Severity, group, save
from sldvexp.errors import UserError
from sldvexp.models import (
    FiniteElementModel,
    FrequencyData,
    ModelParameter,
    ModelSource,
    examine_frequencies,
    update_parameters,
)
from sldvexp.models.estimate import examine_model
from sldvexp.models.responses import respond
from sldvexp.models.result import model_to_datasets
from sldvexp.models.wording import findings_about
from sldvexp.plot import model_shapes
from sldvexp.report.html.modal import model_section
from tests.models.made_models import (
    LASER,
    POSE_STD,
    THICKNESS,
    Measured,
    closed_form,
    true_plate,
)

#: 0.2 % of the plate's mass, kg.
MASS = 0.002 * 2700 * 0.003 * 0.3 * 0.25
#: Tolerances that leave 0.5 % of all frequencies open in common.
KNOWN = {
    "E": ModelParameter(70e9, 0.5 * 0.0198 * 70e9 / 2 * 0.9),
    "rho": ModelParameter(2700.0, 0.004 * 2700),
    "thickness": ModelParameter(THICKNESS, 0.0),
}


@dataclass
class Given(ModelSource):
    """A model that is there already."""

    given: FiniteElementModel | None = field(default=None)

    def inputs(self):
        return []

    def read(self):
        return self.given


def source(model=None, **settings):
    model = closed_form() if model is None else model
    settings = {"parameters": KNOWN, "discretisation": [1e-5]} | settings
    return Given(thickness=model.thickness, given=model, **settings)


@pytest.fixture(scope="module")
def measured():
    return Measured(true_plate())


def examined(measured, source, seed=0, pose_std=POSE_STD):
    return examine_model(measured.tree(seed, pose_std=pose_std), LASER, source)


@pytest.fixture(scope="module")
def right(measured):
    """What is found of a model that is right, once for all; nobody changes it."""
    return examined(measured, source())


def test_right_model_is_accepted_and_says_what_it_could_not_tell(right):
    found = right
    assert not found.shapes_rejected
    assert found.frequency_verdict == "accepted"
    told = {f.kind: f for f in findings_about(found)}
    assert set(told) == {"model_shapes", "model_frequencies", "model_limits"}
    assert {f.severity for f in told.values()} == {Severity.note}
    assert "say nothing of E, rho, thickness" in told["model_limits"].text


@pytest.mark.whole
@pytest.mark.parametrize("sessions", [2, pytest.param(4, marks=pytest.mark.whole)])
def test_mac_of_a_right_model_is_within_its_own_spread(measured, sessions):
    off = []
    for seed in range(sessions):
        found = examined(measured, source(), seed)
        found_group = model_to_datasets(found, {})["model"]
        off += list((found_group.mac_of_pair - found_group.mac_expected) / found_group.mac_std)
    assert np.abs(off).max() < 4
    assert abs(np.mean(off)) < 4 / np.sqrt(len(off))


@pytest.mark.whole
def test_two_thousandths_of_mass_reject_the_shapes_and_stop_the_expansion():
    found = examined(Measured(true_plate(MASS)), source())
    assert found.shapes_rejected
    text = [f.text for f in findings_about(found) if f.kind == "model_shape"]
    assert len(text) >= 4, text
    assert "of its mode 4 (" in text[-1]
    assert "velocity" not in model_to_datasets(found, {})["model/shape"]


def test_thickness_is_told_by_frequencies_and_never_by_shapes(measured, right):
    thick = closed_form(thickness=1.02 * THICKNESS)
    found = examined(measured, source(thick))
    assert found.frequency_verdict == "rejected"
    assert not found.shapes_rejected
    assert found.shapes.chi2 == pytest.approx(right.shapes.chi2, rel=1e-4)
    assert found.frequencies.common == pytest.approx(-np.log(1.02), abs=1e-4)


def test_frequencies_are_not_judged_without_tolerances(measured):
    thick = closed_form(thickness=1.02 * THICKNESS)
    found = examined(measured, source(thick, parameters={}, discretisation=[]))
    assert found.frequency_verdict == "undecided"
    assert "not judged" in {f.kind: f.text for f in findings_about(found)}["model_frequencies_open"]


def made(rng, model, tolerance, thickness=1.0):
    """Frequencies of a structure whose properties are drawn within their tolerances."""
    off = {name: std * rng.normal() for name, std in tolerance.items()}
    power = {"E": 0.5, "rho": -0.5, "thickness": 1.0}
    drawn = np.log(thickness) + sum(power[name] * x for name, x in off.items())
    noise = 4e-6 * rng.normal(size=model.modes) + 1e-5 * rng.normal(size=model.modes)
    data = FrequencyData(
        model.frequency * np.exp(drawn + noise),
        np.diag(np.full(model.modes, 4e-6**2)),
        model.frequency,
        np.full(model.modes, 1e-5),
        {name: np.full(model.modes, power[name]) for name in tolerance},
        tolerance,
    )
    return data, off


def test_frequency_test_keeps_its_size_and_finds_two_hundredths_of_thickness():
    rng, model = np.random.default_rng(0), closed_form()
    known = {"E": 0.009, "rho": 0.004, "thickness": 0.0008}  # 0.5 % of the frequencies
    level, count = 0.025, 400
    rejected = {}
    for factor in (1.0, 1.02):
        found = [examine_frequencies(made(rng, model, known, factor)[0]) for _ in range(count)]
        rejected[factor] = sum(min(f.p_value, f.common_p_value) < level for f in found)
    low, high = stats.binom.ppf([1e-3, 1 - 1e-3], count, 0.05)
    assert rejected[1.0] <= high
    assert rejected[1.0] >= low / 2  # of two tests that are not independent
    assert rejected[1.02] >= 0.95 * count
    unseen = found[0].unseen["thickness"]
    assert 0.015 < unseen < 0.02


def test_adjusted_modulus_is_within_its_bound():
    rng, model, inside = np.random.default_rng(1), closed_form(), 0
    known = {"E": 0.01, "rho": 0.004}
    for _ in range(50):
        data, off = made(rng, model, known)
        found = update_parameters(data, {"E": 0.0})
        inside += abs(np.log(found.factor[0]) - off["E"]) < 1.96 * found.std[0]
        ratio, _ = update_parameters(replace(data, tolerance={"E": 0.0, "rho": 0.0}), {"E": 0.0}), 0
        exact = off["E"] - off["rho"]
        assert abs(np.log(ratio.factor[0]) - exact) < 5 * ratio.std[0]
    assert inside >= 44


@pytest.mark.whole
def test_what_the_frequencies_do_not_determine_is_not_adjusted(measured):
    with pytest.raises(UserError, match="E and thickness change the frequencies"):
        examined(measured, source(adjust={"E": 0.0, "thickness": 0.0}))
    found = examined(measured, source(adjust={"E": 0.0, "thickness": 0.002}))
    assert found.updated.std[0] > 2 * 0.002
    with pytest.raises(UserError, match="no such parameter"):
        source(adjust={"Young": 0.0})


@pytest.mark.parametrize("sessions", [1, pytest.param(3, marks=pytest.mark.whole)])
def test_expanded_modes_lie_within_their_bounds_at_every_node(measured, right, sessions):
    off = []
    for seed in range(sessions):
        found = examined(measured, source(), seed) if seed else right
        found_group = model_to_datasets(found, {})["model/shape"]
        plate, names = measured.plate, measured.plate.mode_names
        for k, name in enumerate(names):
            alone = plate.in_modes({n: float(n == name) for n in names})
            true = alone.velocity(found_group.position.values, float(measured.frequency[k]))[:, 2]
            std = found_group.velocity_std.values[:, 2, k]
            inside = np.isfinite(true) & (std > 1e-3 * std.max())
            error = (found_group.velocity.values[:, 2, k] - true).real
            off.append(error[inside] / std[inside])
    spread = np.sqrt(np.mean(np.concatenate(off) ** 2))
    assert 0.6 < spread < 1.5


@pytest.mark.long
def test_right_model_with_poses_that_are_off_is_rejected_as_often_as_promised(measured):
    count = 200
    rejected = sum(examined(measured, source(), 1000 + s).shapes_rejected for s in range(count))
    assert 0.02 * count <= rejected <= 0.09 * count


def test_model_that_lacks_a_measured_mode_says_so_and_is_kept_in_a_file(measured, tmp_path):
    lacking = closed_form().with_modes(np.array([0, 1, 3, 4]))
    found = examined(measured, source(lacking))
    assert found.pair.tolist() == [0, 1, -1, 2, 3]
    text = {f.kind: f.text for f in findings_about(found)}["model_lacks_mode"]
    assert "measured mode 3 (551.14 Hz) is none of its modes" in text
    groups = model_to_datasets(found, {})
    save(groups, {}, tmp_path / "run.nc")
    run = RunData.from_source(tmp_path / "run.nc")
    assert run.groups["model/image/1"]["paired_mode"].values.tolist() == [1, 2, 4, 5]
    assert np.isnan(run.groups["model"]["chi2"].values).tolist() == [0, 0, 1, 0, 0]
    assert model_section(run).title == "Model"
    assert len(model_shapes(run).axes) >= 8


@pytest.mark.whole
def test_criteria_by_place_and_line_are_near_what_noise_leaves(measured):
    found = examined(measured, source(closed_form((24, 20))), pose_std=None)
    line = np.arange(150.0, 900.0, 10.0)
    rng, images, std = np.random.default_rng(3), {}, 2e-5
    for k, velocity in enumerate(measured.velocity):
        quiet = respond(velocity, measured.frequency, measured.damping, line)
        parts = std * rng.normal(size=(2, *quiet.shape))
        images[str(k + 1)] = group(
            "image",
            {"pixel": np.arange(len(quiet)), "frequency": line},
            velocity=quiet + parts[0] + 1j * parts[1],
            velocity_std=np.full(quiet.shape, std),
        )
    groups = model_to_datasets(found, images)
    pixels = [groups[f"model/image/{k + 1}"] for k in range(5)]
    for name, own in (("csac", [groups["model"]]), ("frac", pixels), ("comac", pixels)):
        off = np.concatenate([((g[name] - g[f"{name}_expected"]) / g[f"{name}_std"]) for g in own])
        assert abs(np.median(off)) < 0.5, name
        assert 0.5 < np.subtract(*np.percentile(off, [75, 25])) / 1.35 < 1.5, name
