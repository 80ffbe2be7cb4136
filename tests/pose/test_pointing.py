"""Pointing noise of the mirrors: found in the edges, in the bounds, and told from other errors."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sldvexp.dataset import Severity
from sldvexp.image.pinhole import WIDEST, blur
from sldvexp.laser import TwoMirror
from sldvexp.laser.two_mirror import Board
from sldvexp.pose import half_width, pointing
from sldvexp.pose.bitangent import Bitangent
from sldvexp.pose.edge import Edge
from sldvexp.pose.pointing import (
    EllipseResiduals,
    Pointing,
    find_pointing,
    mirror_findings,
    pointing_variance,
)
from sldvexp.session.circles import edges_to_dataset
from sldvexp.virtual_lab.scene import MirrorError, MirrorErrors

METHODS = [Edge(), Bitangent()]
#: Stated errors differ as much in a scan with pointing noise, which profiles of edges half see.
STATED = {"std": 0.05, "uneven": 70.0}
#: Unlikeliest false alarm of a seeded draw that a test still takes.
FALSE_ALARM = 1e-3


def residuals(rng, std, extra, count=40):
    """Edges of one circle with five free numbers, stated errors and others besides."""
    design = rng.standard_normal((count, 5))
    stated = np.broadcast_to(std, count)
    noise = np.hypot(stated, extra) * rng.standard_normal(count)
    return EllipseResiduals(noise, design, stated, np.linspace(0, 6, count))


def estimate(lab, rng, method, every=1):
    """Pose of a session with its own object and noise, and its errors (6,).

    Of all its edges, or of every so many.
    """
    lab.machine(rng)
    tree = {k: g.isel(edge=slice(None, None, every)) for k, g in lab.tree(rng).items()}
    found = method.estimate(lab.laser, lab.target, tree)
    pose = found.pose.isel(view=0)
    solved = SimpleNamespace(rotation=pose["rotation"].values, origin=pose["origin"].values)
    return found, pose, lab.error("a", solved)


def kinds(found):
    return [(f.kind, f.subject) for f in found.findings]


def test_equal_errors_give_the_variance_of_the_residuals_less_the_stated_one():
    rng = np.random.default_rng(1)
    one, two = (residuals(rng, 0.1, 0.3) for _ in range(2))
    left = sum(
        np.sum((r.distance - r.design @ np.linalg.lstsq(r.design, r.distance)[0]) ** 2)
        for r in (one, two)
    )
    assert pointing_variance([one, two]) == pytest.approx(left / 70 - 0.1**2, rel=1e-9)


def test_restricted_likelihood_is_largest_at_the_variance_found():
    rng = np.random.default_rng(2)
    each = [residuals(rng, 0.02 * 70 ** rng.random(40), 0.2) for _ in range(3)]

    def likelihood(variance):
        total = 0.0
        for r in each:
            weight, residual, _ = r.whitened(variance)
            information = r.design.T @ (weight[:, None] * r.design)
            total += np.log(weight).sum() - residual @ residual - np.linalg.slogdet(information)[1]
        return total

    found = pointing_variance(each)
    for factor in (0.99, 1.01):
        assert likelihood(factor * found) < likelihood(found)


def test_what_the_likelihood_solves_is_what_it_says():
    """``sum (P d)^2 - tr P`` with the whole matrix P, of errors that differ a hundredfold."""
    rng = np.random.default_rng(4)
    r = residuals(rng, 0.02 * 100 ** rng.random(40), 0.2)
    for variance in (0.0, 0.04, 1.0):
        w = np.diag(1.0 / (r.std**2 + variance))
        x = w @ r.design
        p = w - x @ np.linalg.solve(r.design.T @ x, x.T)
        expected = float(np.sum((p @ r.distance) ** 2) - np.trace(p))
        assert r.excess(variance) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.trace(w))


def test_errors_as_stated_leave_no_room_for_pointing_noise():
    rng = np.random.default_rng(3)
    half = [residuals(rng, 0.1, 0.0) for _ in range(4)]
    assert pointing_variance([replace(r, distance=r.distance / 2) for r in half]) == 0.0


@pytest.mark.one_in(2)
@pytest.mark.parametrize("pointing", [0.2, 1.0])
def test_pointing_noise_is_found_as_well_as_its_edges_tell(edge_lab, pointing):
    lab = edge_lab(pointing=pointing, **STATED)
    rng = np.random.default_rng(4)
    drawn = [find_pointing(list(lab.edges(rng)["a"].values()), lab.laser)[0] for _ in range(4)]
    std, dof = np.array([p.whole for p in drawn]), drawn[0].dof
    assert 140 < dof < 250
    limit = 4 * pointing / np.sqrt(2 * 156 * len(drawn)) * 1.2  # stated errors hide a part of it
    assert abs(std.mean() - pointing) < limit


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_residuals_that_pointing_noise_explains_are_a_note(edge_lab, method):
    found, pose, _ = estimate(edge_lab(pointing=0.4, **STATED), np.random.default_rng(5), method)
    ((kind, subject),) = kinds(found)
    (note,) = found.findings
    assert (kind, subject, note.severity) == ("pointing", "view a", Severity.note)
    assert note.size == pytest.approx(0.4, rel=0.2) == float(pose["pointing_std"])
    assert f"{note.size:.2g} DAC steps" in note.text
    assert pose["pointing_std"].attrs["units"] == "1"


def noise(whole, stated=0.0):
    """Pointing noise of a view, DAC steps, all else being in order."""
    each = np.full(4, whole)
    return Pointing(each, each, 150.0, 150.0, 150.0, stated, 1.0, np.ones(4))


@pytest.mark.parametrize(("board", "steps"), [(Board.bits_12_sign, 1), (Board.bits_16, 8)])
def test_mirrors_are_judged_by_angles_and_not_by_the_steps_of_a_board(board, steps):
    """One step of 12 bits is 107 microrad, and 10 of them are in good order."""
    laser = TwoMirror(board=board)
    found = {"a": noise(0.3 * steps), "b": noise(0.08 * steps), "c": noise(0.5 * steps)}
    (said,) = mirror_findings(found, laser)
    assert (said.subject, said.severity) == ("views a, c", Severity.note)
    wide = "0.3 to 0.5" if steps == 1 else "2.4 to 4"
    assert said.text.startswith(f"views a, c: the edges scatter by {wide} DAC steps rms more than")
    assert "at most 53 microrad or 0.053 mm at 1 m" in said.text
    assert said.size == 0.5 * steps


def test_pointing_noise_that_a_laser_is_said_to_have_is_no_finding():
    found = {"a": noise(0.3), "b": noise(0.5, stated=0.2)}
    assert len(list(mirror_findings(found, TwoMirror(pointing_std=0.25)))) == 1
    assert not list(mirror_findings(found, TwoMirror(pointing_std=0.35)))


@pytest.mark.whole
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_clean_edges_are_passed_over_in_silence(edge_lab, method):
    lab, rng = edge_lab(views=2, **STATED), np.random.default_rng(6)
    for _ in range(4):
        assert kinds(estimate(lab, rng, method)[0]) == []


@pytest.mark.whole
def test_a_circle_that_is_noisier_than_the_others_is_named_and_weighed_less(edge_lab):
    lab = edge_lab(pointing=[0.2, 0.2, 0.2, 0.9], **STATED)
    found, pose, _ = estimate(lab, np.random.default_rng(7), Edge())
    assert kinds(found) == [("pointing", "view a"), ("noisy_circle", "circle 4")]
    alike = edge_lab(pointing=0.9, **STATED)
    _, wide, _ = estimate(alike, np.random.default_rng(7), Edge())
    assert (pose["origin_std"] < 0.75 * wide["origin_std"]).all()


@pytest.mark.whole
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_edges_of_a_noisy_circle_do_not_make_the_others_wrong(edge_lab, method):
    """Few edges tell a circle's own noise badly; circles that are alike share theirs."""
    lab, rng = edge_lab(pointing=[0.2, 0.2, 0.2, 1.2], **STATED), np.random.default_rng(12)
    for _ in range(4):
        found, _, _ = estimate(lab, rng, method, every=2)
        assert kinds(found) == [("pointing", "view a"), ("noisy_circle", "circle 4")]


@pytest.mark.whole
def test_circles_with_the_same_noise_differ_no_oftener_than_said(edge_lab):
    lab, rng = edge_lab(pointing=0.5, **STATED), np.random.default_rng(8)
    each = [find_pointing(list(lab.edges(rng)["a"].values()), lab.laser)[0] for _ in range(20)]
    differ = np.array([p.differ for p in each])
    assert np.mean(differ < 0.5) == pytest.approx(0.5, abs=4 * np.sqrt(0.25 / len(each)))
    assert differ.min() > FALSE_ALARM


@pytest.mark.whole
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_a_wrong_gain_is_not_taken_for_pointing_noise(edge_lab, method):
    wrong = MirrorErrors(up_down=MirrorError(gain=0.02))
    lab = edge_lab(pointing=0.2, mirrors=wrong, **STATED)
    found, pose, _ = estimate(lab, np.random.default_rng(9), method)
    names = "gain_up_down or mirror_offset"  # one view of one plane does not tell them apart
    assert kinds(found) == [("pointing", "view a"), ("calibration", names)]
    assert found.findings[1].severity is Severity.void
    assert float(pose["pointing_std"]) == pytest.approx(0.2, rel=0.2)


def test_edges_that_bend_as_no_ellipse_does_are_not_taken_for_noise(edge_lab):
    lab = edge_lab(pointing=0.1, **STATED)
    edges = lab.edges(np.random.default_rng(10))["a"]
    turn = 2 * np.pi * np.arange(44) / 44
    hidden = 0.5 * np.cos(3 * turn)[:, None] * edges[2].direction
    edges[2] = replace(edges[2], position=edges[2].position + hidden)
    tree = {"edge/a": edges_to_dataset(list(edges.values()))}
    found = Edge().estimate(lab.laser, lab.target, tree)
    assert ("edges", "circle 2") in kinds(found)
    assert {f.severity for f in found.findings if f.kind == "edges"} == {Severity.doubtful}


def spread_and_coverage(lab, method, sessions, seed, every=1):
    rng = np.random.default_rng(seed)
    errors, std, width = [], [], []
    for _ in range(sessions):
        _, pose, error = estimate(lab, rng, method, every)
        errors.append(error)
        std.append(np.sqrt(np.diag(pose["covariance"].values)))
        width.append(half_width(std[-1], pose["dof"].values, 0.95))
    errors = np.array(errors)
    ratio = np.sqrt(np.mean(errors**2, axis=0) / np.mean(np.square(std), axis=0))
    return ratio, np.mean(np.abs(errors) <= width, axis=0)


@pytest.mark.whole
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_bounds_have_pointing_noise_in_them(edge_lab, method):
    sessions = 16
    lab = edge_lab(pointing=0.5, **STATED)
    ratio, cover = spread_and_coverage(lab, method, sessions, seed=11)
    np.testing.assert_allclose(ratio, 1.0, atol=4 / np.sqrt(2 * sessions))
    assert (cover >= 0.95 - 4 * np.sqrt(0.95 * 0.05 / sessions)).all()
    assert ratio.mean() == pytest.approx(1.0, abs=4 / np.sqrt(2 * sessions) / np.sqrt(3))


@pytest.mark.long
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
@pytest.mark.parametrize(
    ("pointing", "every"),
    [(0.0, 1), (0.0, 4), (0.5, 1), (0.5, 4), ([0.2, 0.2, 0.2, 0.9], 1)],
    ids=["none", "none, 11 lines", "alike", "alike, 11 lines", "a noisy circle"],
)
def test_bounds_have_the_noise_of_each_circle_in_them(edge_lab, pointing, every, method):
    sessions = 200
    lab = edge_lab(pointing=pointing, **STATED)
    ratio, cover = spread_and_coverage(lab, method, sessions, seed=13, every=every)
    limit = np.sqrt(0.95 * 0.05 / sessions)
    assert cover.mean() == pytest.approx(0.95, abs=3 * limit / np.sqrt(2))  # six that correlate
    np.testing.assert_allclose(cover, 0.95, atol=4 * limit)
    np.testing.assert_allclose(ratio, 1.0, atol=4 / np.sqrt(2 * sessions))


@pytest.mark.long
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
@pytest.mark.parametrize("pointing", [0.0, 0.5])
def test_right_circles_and_mirrors_raise_no_alarm(edge_lab, pointing, method):
    """Each kind of alarm as seldom as said, in sessions of three views."""
    sessions, rng = 200, np.random.default_rng(14)
    lab = edge_lab(views=3, pointing=pointing, **STATED)
    told = [kinds(estimate(lab, rng, method)[0]) for _ in range(sessions)]
    alarms = [{kind for kind, _ in found} - {"pointing"} for found in told]
    most = 0.01 * sessions + 3 * np.sqrt(0.01 * sessions)
    assert sum(map(bool, alarms)) <= most


@pytest.mark.one_in(2)
@pytest.mark.parametrize("wide", [(0,), (0, 1, 2, 3)])
def test_what_a_spot_that_is_too_wide_adds_to_errors_does_not_hide_the_noise(edge_lab, wide):
    """Such a circle's edges scatter about its ellipse as those of others do."""
    lab = edge_lab(**STATED, pointing=0.1)
    edges = list(lab.edges(np.random.default_rng(3))["a"].values())
    for k in wide:
        width = 0.4 * np.ptp(edges[k].position, axis=0).min() / 2
        edges[k] = replace(edges[k], width=np.full_like(edges[k].width, width))
    found, fits = find_pointing(edges, lab.laser)
    assert [k for k, fit in enumerate(fits) if blur(*fit) > WIDEST] == list(wide)
    assert found.differ > FALSE_ALARM
    # Of 156 degrees of freedom, 4 standard errors.
    assert found.std == pytest.approx(0.1, rel=0.25)


def test_ellipses_of_the_same_edges_are_found_once(edge_lab, monkeypatch):
    """Methods that are compared, and runs of a sweep over them, have them in common."""
    fitted, settle = [], pointing._settle
    monkeypatch.setattr(pointing, "_settle", lambda *args: fitted.append(args) or settle(*args))
    lab = edge_lab(**STATED, pointing=0.1)
    edges = list(lab.edges(np.random.default_rng(3))["a"].values())
    first = find_pointing(edges, lab.laser)
    once = len(fitted)
    same = [replace(e, position=e.position.copy()) for e in edges]
    again = find_pointing(same, lab.laser)
    assert len(fitted) == once
    assert again[0] is first[0]
    assert [a is b for a, b in zip(again[1], first[1], strict=True)] == [True] * len(edges)
    for others in (
        (edges, replace(lab.laser, mirror_offset=lab.laser.mirror_offset + 1e-9)),
        ([*edges[:-1], replace(edges[-1], std=edges[-1].std * (1 + 1e-9))], lab.laser),
        ([*edges[:-1], replace(edges[-1], width=edges[-1].width + 1e-9)], lab.laser),
    ):
        before = len(fitted)
        find_pointing(*others)
        assert len(fitted) > before
