"""Maps of the middle surface: size, power, layers, and what is said."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sldvexp.check import Examination
from sldvexp.check.middle_surface import MiddleSurface, by_layers, by_lever_arm
from sldvexp.dataset import Severity, group, take_findings
from sldvexp.errors import ConfigError, UserError
from sldvexp.reconstruction.contravariant import Contravariant
from sldvexp.shell import Outline
from tests.check.test_lever_arm import MODES, most_by_chance, plate
from tests.shell import simulated_physics as physics
from tests.shell import simulated_shell as lab

LINES = tuple(MODES)
PATCHES = (4, 4)


@pytest.fixture(scope="module")
def found():
    return physics.estimated(plate(LINES), np.random.default_rng(0), LINES)


def volume(shape=(33, 27)):
    made = lab.volume(shape=shape)
    made.layers, made.thickness = 5, 0.02
    return made


def layers(rng, offset=0.0, noise=1e-4, of=None):
    """A field in the layers of a volume whose middle is given too high by `offset`, m."""
    grid, truth = of or volume(), plate(LINES)
    prisms = grid.prisms()
    points = prisms.position - lab.CENTER
    velocity = np.zeros((len(points), 3, len(LINES)), complex)
    for i, f in enumerate(LINES):
        w = [truth.derivative(points[:, :2], f, *d) for d in ((1, 0), (0, 1), (0, 0))]
        z = points[:, 2] + offset
        velocity[..., i] = np.stack([-z * w[0], -z * w[1], w[2]], axis=-1)
    shaken = rng.normal(size=velocity.shape) + 1j * rng.normal(size=velocity.shape)
    field = group(
        "field",
        {"component": ["x", "y", "z"], "frequency": list(LINES)},
        velocity=velocity + noise * shaken,
        element=prisms.element,
    )
    stored = group("volume", {}, depth=prisms.depth)
    return {"field": field, "volume": stored}, grid


def mapped(rng, offset=0.0):
    groups, grid = layers(rng, offset)
    run = Examination(groups, rng=rng)
    return by_layers(run, "field", Outline.of(grid, grid.prisms(), 0.0), PATCHES)


@pytest.mark.whole
def test_as_many_maps_are_rejected_as_stated(found):
    rng, trials = np.random.default_rng(1), 12
    again = [physics.renoised(found, plate(LINES), rng) for _ in range(trials)]
    maps = [by_lever_arm(one, PATCHES, 4) for one in again]
    assert sum(m.p_value < 0.05 for m in maps) <= most_by_chance(trials, 0.05)
    z = np.array([m.height / m.std for m in maps])
    assert z.std() == pytest.approx(1.0, abs=0.25)
    assert np.abs(z.mean(axis=0)).max() < 4 / np.sqrt(trials)


@pytest.mark.whole
def test_as_many_maps_of_layers_are_rejected_as_stated():
    rng, trials = np.random.default_rng(2), 40
    maps = [mapped(rng) for _ in range(trials)]
    assert sum(m.p_value < 0.05 for m in maps) <= most_by_chance(trials, 0.05)
    z = np.array([m.height / m.std for m in maps])
    assert np.nanstd(z) == pytest.approx(np.sqrt(8 / 6), abs=0.2)


def test_layers_find_the_middle_and_not_the_face():
    """Given half a thickness too high, it is found half a thickness lower."""
    found = mapped(np.random.default_rng(3), 1.5e-3)
    assert found.mean == pytest.approx(-1.5e-3, abs=4 * found.mean_std)
    assert found.mean_std < 0.05e-3
    assert found.p_value < 1e-3


def test_a_corner_that_lies_higher_is_found_where_it_is():
    """By 0.2 mm over a quarter of the plate."""
    truth = plate(LINES, bump=-0.2e-3)
    maps = by_lever_arm(physics.estimated(truth, np.random.default_rng(4), LINES), PATCHES, 4)
    height = maps.height.reshape(PATCHES)
    assert maps.p_value < 1e-6
    assert height[2:, 2:].mean() == pytest.approx(0.2e-3, abs=0.05e-3)
    assert np.abs(np.mean([height[:2].mean(), height[2:, :2].mean()])) < 0.05e-3


def examined(monkeypatch, found, groups, grid, **methods):
    monkeypatch.setattr("sldvexp.check.on_surface.reconstruct_surface", lambda *_: found)
    named = {"reconstruction": methods.pop("field")}
    experiment = SimpleNamespace(
        laser=None, volume=grid, material=lab.SHEET, **named, compare=methods
    )
    run = Examination(groups, rng=np.random.default_rng(0), experiment=experiment)
    return MiddleSurface(patches=list(PATCHES)).examine(run)


def test_the_check_maps_both_ways(monkeypatch, found):
    groups, grid = layers(np.random.default_rng(5), of=volume((13, 11)))
    groups["compare/samplewise"] = groups.pop("field")
    groups["field"] = groups["compare/samplewise"]
    methods = {"field": lab.method(), "samplewise": Contravariant()}
    both = examined(monkeypatch, found, groups, grid, **methods)
    assert set(both.data_vars) >= {"by_layers", "by_layers_std", "by_lever_arm"}
    (finding,) = take_findings({"examined/middle_surface": both})
    assert finding.severity is Severity.note
    lower, grid = layers(np.random.default_rng(6), 0.4e-3)
    alone = examined(monkeypatch, found, lower, grid, field=Contravariant())
    assert "by_lever_arm" not in alone
    (finding,) = take_findings({"examined/middle_surface": alone})
    assert finding.severity is Severity.doubtful
    assert "does not lie where it is given: -0.4" in finding.text


def test_a_volume_too_coarse_for_the_patches_is_told():
    groups, grid = layers(np.random.default_rng(7), of=volume((4, 3)))
    outline = Outline.of(grid, grid.prisms(), 0.0)
    run = Examination(groups, rng=np.random.default_rng(0))
    with pytest.raises(UserError, match=r"too few nodes for 4 x 4 patches"):
        by_layers(run, "field", outline, PATCHES)


@pytest.mark.parametrize("settings", [{"patches": [4]}, {"patches": [0, 2]}, {"level": 2.0}])
def test_settings_that_cannot_be(settings):
    with pytest.raises(ConfigError):
        MiddleSurface(**settings)


@pytest.mark.long
def test_size_in_sixty_sessions():
    """Whole fits with poses drawn."""
    rejected, held = [], []
    for seed in range(60):
        rng = np.random.default_rng(2000 + seed)
        one = by_lever_arm(physics.estimated(plate(), rng, pose_std=(3e-6, 4e-6)), PATCHES, 4)
        rejected.append(one.p_value < 0.05)
        held.append(np.abs(one.height) < 1.96 * one.std)
    print(np.mean(rejected), np.mean(held))
    assert np.mean(rejected) <= 0.10
    assert np.mean(held) > 0.92
