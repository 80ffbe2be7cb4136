"""Every interpolation on every kind of image: exactness, rates, gradients, noise, flags."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from sldvexp.errors import UserError
from sldvexp.image import Interpolation, Interpolator
from sldvexp.image.interpolation import methods as ways
from sldvexp.image.interpolation.base import PixelWeights
from sldvexp.image.interpolation.cross_validation import is_negligible, predictions
from sldvexp.image.interpolation.cubic import CubicInterpolator
from sldvexp.image.interpolation.mesh import Lattice, StraightLattice, Triangles
from sldvexp.image.interpolation.methods import LinearInterpolator, mesh_of

HALF = 500.0


@dataclass
class Image:
    """Pixels without a view."""

    dac: np.ndarray
    shape: tuple[int, int] | None = None
    flags: np.ndarray | None = None
    velocity: np.ndarray | None = None
    std: np.ndarray | None = None
    name: str = "left"

    def __post_init__(self) -> None:
        n = len(self.dac)
        self.usable = np.ones(n, bool) if self.flags is None else ~self.flags
        self.dropped = np.zeros(n, bool)
        self.velocity = np.zeros((n, 1), complex) if self.velocity is None else self.velocity
        self.std = np.full(n, 1e-5) if self.std is None else self.std


def tensor(rows: np.ndarray, columns: np.ndarray) -> Image:
    grid = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1)
    return Image(grid.reshape(-1, 2).astype(float), (len(rows), len(columns)))


def even(n: int) -> Image:
    return tensor(np.linspace(-HALF, HALF, n), np.linspace(-HALF, HALF, n))


def rounded(n: int) -> Image:
    """Whole steps over a box, the second mirror the other way round."""
    return tensor(np.rint(np.linspace(-500, 533, n)), np.rint(np.linspace(520, -540, n + 2)))


def oblique(n: int, whole: bool = True) -> Image:
    """A bilinear map of four corners, rounded to whole steps."""
    s, t = (x[..., None] for x in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n + 3)))
    a, b, c, d = np.array([(-700, -150), (100, -720), (710, 120), (-180, 690)], float)
    grid = (1 - s) * (1 - t) * a + s * (1 - t) * b + s * t * c + (1 - s) * t * d
    return Image((np.rint(grid) if whole else grid).reshape(-1, 2), (n + 3, n))


def scattered(n: int) -> Image:
    """Jittered, so that the distance of neighbours falls as 1 / n everywhere."""
    step = 2 * HALF / (n - 1)
    dac = even(n).dac + np.random.default_rng(n).uniform(-0.3, 0.3, (n * n, 2)) * step
    return Image(dac)


KINDS: dict[str, tuple[Callable[[int], Image], type]] = {
    "even": (even, StraightLattice),
    "rounded": (rounded, StraightLattice),
    "oblique": (oblique, Lattice),
    "scattered": (scattered, Triangles),
}
cases = pytest.mark.parametrize("kind", KINDS)
methods = pytest.mark.parametrize("method", [Interpolation.linear, Interpolation.cubic])


def places(count: int = 4000, half: float = 300.0, seed: int = 1) -> np.ndarray:
    """Places that all images hold."""
    return np.random.default_rng(seed).uniform(-half, half, (count, 2))


def linear(p: np.ndarray) -> np.ndarray:
    return 3.0 + p @ [0.7, -0.3]


def quadratic(p: np.ndarray) -> np.ndarray:
    x, y = p.T / 100.0
    return linear(p) + 5 * x * x - 7 * x * y + 2 * y * y


def smooth(p: np.ndarray) -> np.ndarray:
    return np.sin(p[:, 0] / 150 + 0.3) * np.cos(p[:, 1] / 170 - 0.2)


def found(w: PixelWeights) -> np.ndarray:
    return ~(w.outside | w.flagged)


@cases
def test_kinds(kind: str) -> None:
    make, mesh = KINDS[kind]
    assert type(mesh_of(make(31))) is mesh


@cases
@methods
def test_acceptance(kind: str, method: Interpolation) -> None:
    image, x = KINDS[kind][0](31), places()
    interpolator = method.prepare(image)
    w = interpolator.at(x)
    assert found(w).all()
    assert w.value.shape == (len(x), len(image.dac))
    np.testing.assert_allclose(w.value.sum(axis=1), 1.0, atol=1e-12)
    exact = [(linear, lambda p: np.tile([0.7, -0.3], (len(p), 1)))]
    if method is Interpolation.cubic:
        by_x = lambda p: np.stack([p @ [10, -7], p @ [-7, 4]], axis=-1) / 1e4 + [0.7, -0.3]  # noqa: E731
        exact.append((quadratic, by_x))
    for function, gradient in exact:
        scale = np.abs(function(x)).max()
        np.testing.assert_allclose(w.value @ function(image.dac), function(x), atol=1e-12 * scale)
        by_dac = interpolator.slopes(w.located, x, function(image.dac)[:, None])[..., 0]
        np.testing.assert_allclose(by_dac.T, gradient(x), atol=1e-12 * scale)


@cases
@methods
def test_pixels_keep_their_values(kind: str, method: Interpolation) -> None:
    image = KINDS[kind][0](21)
    inner = np.flatnonzero((np.abs(image.dac) < 300).all(axis=1))
    w = method.prepare(image).at(image.dac[inner])
    unit = np.zeros((len(inner), len(image.dac)))
    unit[np.arange(len(inner)), inner] = 1.0
    np.testing.assert_allclose(w.value.toarray(), unit, atol=1e-12)


@cases
@methods
def test_gradient(kind: str, method: Interpolation) -> None:
    image, x, h = KINDS[kind][0](21), places(400), 1e-3
    values = np.random.default_rng(3).normal(size=len(image.dac))
    interpolator = method.prepare(image)
    # A difference across the edge of a cell is none.
    cell = interpolator.mesh.find
    slopes = interpolator.slopes(interpolator.at(x).located, x, values[:, None])[..., 0]
    for axis, slope in enumerate(slopes):
        step = h * np.eye(2)[axis]
        same = (cell(x + step) == cell(x)) & (cell(x - step) == cell(x))
        assert same.mean() > 0.98
        ahead, behind = (interpolator.at(x + s).value @ values for s in (step, -step))
        difference = (ahead - behind) / (2 * h)
        np.testing.assert_allclose(slope[same], difference[same], atol=1e-6)


@pytest.mark.one_in(6)
@pytest.mark.parametrize("sizes", [(25, 49), (25, 49, 97)], ids=len)
@pytest.mark.parametrize("kind", ["even", "oblique", "scattered"])
@methods
def test_rate(kind: str, method: Interpolation, sizes: tuple[int, ...]) -> None:
    def error(n: int) -> float:
        image = oblique(n, whole=False) if kind == "oblique" else KINDS[kind][0](n)
        w = method.prepare(image).at(places())
        return float(np.sqrt(np.mean((w.value @ smooth(image.dac) - smooth(places())) ** 2)))

    errors = [error(n) for n in sizes]
    rates = -np.diff(np.log2(errors))
    if method is Interpolation.linear:
        np.testing.assert_allclose(rates, 2.0, atol=0.15)
    else:
        assert (rates > 2.75).all()


@pytest.mark.one_in(4)
@pytest.mark.parametrize("kind", ["even", "oblique"])
@pytest.mark.parametrize("hole", [0, 3])
def test_the_mean_of_a_cell_beside_missing_pixels_has_no_error_of_third_order(
    kind: str, hole: int
) -> None:
    """At the border, or around a hole of 3 x 3: as inside, where errors of both sides cancel."""
    part = np.stack(np.meshgrid(*[np.arange(0.05, 1.0, 0.1)] * 2), axis=-1).reshape(-1, 2)

    def error(n: int) -> float:
        image = oblique(n, whole=False) if kind == "oblique" else even(n)
        rows, columns = image.shape or (n, n)
        missing = np.zeros((rows, columns), bool)
        middle = rows // 2, columns // 2
        missing[tuple(slice(m, m + hole) for m in middle)] = True
        image.usable = ~missing.ravel()
        beside = binary_dilation(missing, np.ones((3, 3))) if hole else missing
        if not hole:
            beside[[0, -1]] = beside[:, [0, -1]] = True
        mesh = mesh_of(image)
        kept = image.usable[mesh.cells].all(axis=1) & beside.ravel()[mesh.cells].any(axis=1)
        a, b, c, d = np.moveaxis(mesh.vertices[mesh.cells[kept]][:, None], 2, 0)
        s, t = part[:, :1], part[:, 1:]
        x = (1 - s) * (1 - t) * a + s * (1 - t) * b + s * t * c + (1 - s) * t * d
        places = x.reshape(-1, 2)
        off = Interpolation.cubic.prepare(image).at(places).value @ smooth(image.dac)
        off -= smooth(places)
        return float(np.sqrt(np.mean(off.reshape(len(x), -1).mean(axis=1) ** 2)))

    assert np.log2(error(33) / error(65)) > 3.5


def test_even_lattice_has_the_catmull_rom_cubic() -> None:
    image = tensor(np.arange(9) * 4.0, np.arange(8) * 7.0)
    x = np.random.default_rng(4).uniform([4, 7], [28, 42], (200, 2))
    w = Interpolation.cubic.prepare(image).at(x).value.toarray().reshape(-1, 9, 8)

    def keys(s: np.ndarray) -> np.ndarray:
        s = np.abs(s)
        near, far = 1.5 * s**3 - 2.5 * s**2 + 1, -0.5 * s**3 + 2.5 * s**2 - 4 * s + 2
        return np.where(s < 1, near, np.where(s < 2, far, 0.0))

    rows, columns = keys(x[:, :1] / 4 - np.arange(9)), keys(x[:, 1:] / 7 - np.arange(8))
    np.testing.assert_allclose(w, rows[:, :, None] * columns[:, None, :], atol=1e-12)


@cases
@methods
def test_standard_error(kind: str, method: Interpolation) -> None:
    trials, rng = 3000, np.random.default_rng(5)
    image, x = KINDS[kind][0](21), places(60)
    std = rng.uniform(0.5, 2.0, len(image.dac))
    w = method.prepare(image).at(x).value
    values = w @ (std[:, None] * rng.normal(size=(len(std), trials)))
    ratio = values.std(axis=1) / np.sqrt(w.power(2) @ std**2)
    # The standard deviation of normal trials errs by 1 / sqrt(2 trials); 60 places at 4.5 of that.
    assert np.abs(ratio - 1).max() < 4.5 / np.sqrt(2 * trials)


@methods
def test_order_of_scattered_pixels_does_not_matter(method: Interpolation) -> None:
    # A lattice without its shape: Delaunay's triangles are not unique.
    image, x = Image(even(15).dac), places(300)
    order = np.random.default_rng(6).permutation(len(image.dac))
    w = method.prepare(image).at(x)
    turned = method.prepare(Image(image.dac[order])).at(x)
    np.testing.assert_allclose(turned.value.toarray(), w.value.toarray()[:, order], atol=1e-13)


@cases
@methods
def test_nothing_outside(kind: str, method: Interpolation) -> None:
    image = KINDS[kind][0](21)
    low, high = image.dac.min(axis=0), image.dac.max(axis=0)
    middle = (low + high) / 2
    x = np.array([[low[0] - 0.01, middle[1]], [middle[0], high[1] + 0.01], [1e5, -1e5], [0, 0]])
    w = method.prepare(image).at(x)
    assert w.outside.tolist() == [True, True, True, False]
    assert not w.flagged.any()
    assert np.diff(w.value.indptr)[:3].tolist() == [0, 0, 0]


@pytest.mark.whole
@pytest.mark.parametrize("n", [240, 300])
def test_oblique_lattice_of_few_steps_a_cell(n: int) -> None:
    """Rounding moves corners by up to a quarter of a cell; no place falls between cells."""
    image = oblique(n)
    mesh = mesh_of(image)
    assert isinstance(mesh, Lattice)
    corners = mesh.vertices[mesh.cells]
    rng = np.random.default_rng(7)
    share = rng.dirichlet(np.ones(4), len(corners))
    share[: len(corners) // 4, 2:] = 0.0  # on an edge
    share /= share.sum(axis=1, keepdims=True)
    x = np.einsum("ck,cki->ci", share, corners)
    w = LinearInterpolator(mesh).at(x)
    assert not w.outside.any()
    np.testing.assert_allclose(w.value @ linear(image.dac), linear(x), atol=1e-9)
    assert w.value.min() > -1e-9


@methods
@pytest.mark.parametrize("how", ["folded by rounding", "to and fro"])
def test_lattice_that_is_none_is_triangulated(how: str, method: Interpolation) -> None:
    if how == "to and fro":
        image = even(15)
        rows = image.dac.reshape(15, 15, 2)
        rows[1::2] = rows[1::2, ::-1].copy()
        x = places(200)
    else:
        image = oblique(31)
        image.dac = np.rint(image.dac / 40)
        x = places(200) / 40
    image.velocity = linear(image.dac)[:, None] + 0j
    interpolator = method.prepare(image)
    assert type(interpolator.mesh) is Triangles
    w = interpolator.at(x)
    assert found(w).all()
    np.testing.assert_allclose(w.value @ linear(image.dac), linear(x), atol=1e-9)


@pytest.mark.parametrize("kind", ["even", "oblique"])
@methods
def test_flags_on_a_lattice(kind: str, method: Interpolation) -> None:
    image, x = KINDS[kind][0](21), places()
    flagged = np.random.default_rng(8).random(len(image.dac)) < 0.05
    interpolator = method.prepare(Image(image.dac, image.shape, flagged))
    w = interpolator.at(x)
    whole = LinearInterpolator(mesh_of(image)).at(x).value
    np.testing.assert_array_equal(w.flagged, whole @ flagged > 0)
    assert not w.outside.any()
    # What a flagged pixel holds does not matter, and a second order is kept by its neighbours.
    function = linear if method is Interpolation.linear else quadratic
    values = np.where(flagged, np.nan, function(image.dac))
    np.testing.assert_allclose((w.value @ values)[found(w)], function(x)[found(w)], atol=1e-9)
    slopes = interpolator.slopes(w.located, x[w.located.place], values[:, None])
    assert np.isfinite(slopes).all()


@methods
def test_flags_among_scattered_pixels(method: Interpolation) -> None:
    """One pixel is bridged, a hole stays a hole."""
    image = scattered(31)
    alone = np.argmin(np.square(image.dac - [-200, -200]).sum(axis=1))
    hole = np.square(image.dac - [150, 150]).sum(axis=1) < 120**2
    flags = hole | (np.arange(len(hole)) == alone)
    x = np.concatenate([image.dac[alone] + places(50, 3.0), 150 + places(50, 60.0)])
    w = method.prepare(Image(image.dac, None, flags)).at(x)
    assert found(w).tolist() == [True] * 50 + [False] * 50
    assert w.flagged[50:].all()
    values = np.where(flags, np.nan, linear(image.dac))
    np.testing.assert_allclose((w.value @ values)[:50], linear(x[:50]), atol=1e-9)


def test_pixels_at_one_place_are_averaged() -> None:
    image = Image(np.concatenate([even(5).dac, [[0.0, 0.0]] * 2]))
    image.std = np.full(27, 1e-3)
    image.std[25] = 0.5e-3
    w = LinearInterpolator(mesh_of(image)).at(np.zeros((1, 2))).value.toarray()[0]
    np.testing.assert_allclose(w[[12, 25, 26]], [1 / 6, 4 / 6, 1 / 6], atol=1e-12)
    image.std[25] = 0.0
    w = LinearInterpolator(mesh_of(image)).at(np.zeros((1, 2))).value.toarray()[0]
    np.testing.assert_allclose(w[[12, 25, 26]], 1 / 3, atol=1e-12)


def test_blocks_are_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    image, x = rounded(21), places(100, 700.0)
    interpolator = Interpolation.cubic.prepare(image)
    whole = interpolator.at(x)
    at, values = whole.located, np.random.default_rng(7).normal(size=(len(image.dac), 2))
    slopes = interpolator.slopes(at, x[at.place], values)
    monkeypatch.setattr("sldvexp.image.interpolation.cubic.BLOCK", 17)
    parts = interpolator.at(x)
    np.testing.assert_allclose(parts.value.toarray(), whole.value.toarray(), atol=1e-14)
    np.testing.assert_allclose(interpolator.slopes(at, x[at.place], values), slopes, atol=1e-14)
    np.testing.assert_array_equal(parts.outside, whole.outside)


@methods
def test_slopes_stay_when_weights_are_sorted(method: Interpolation) -> None:
    """Products with a matrix may put its weights into another order, in place."""
    image, x = rounded(21), places(100, 700.0)
    interpolator = method.prepare(image)
    weights, values = interpolator.at(x), np.random.default_rng(7).normal(size=(len(image.dac), 2))
    at = weights.located
    slopes = interpolator.slopes(at, x[at.place], values)
    weights.value.sort_indices()
    np.testing.assert_array_equal(interpolator.slopes(at, x[at.place], values), slopes)


@pytest.mark.parametrize("kind", ["even", "scattered"])
@methods
def test_no_places(kind: str, method: Interpolation) -> None:
    w = method.prepare(KINDS[kind][0](7)).at(np.empty((0, 2)))
    assert w.value.shape == (0, 49)
    assert w.outside.shape == w.flagged.shape == (0,)


@methods
def test_smallest_images(method: Interpolation) -> None:
    for image in (tensor(np.array([0, 10]), np.array([0, 10])), Image(even(2).dac[:3] / 50)):
        x = image.dac.mean(axis=0)[None]
        w = method.prepare(image).at(x)
        np.testing.assert_allclose(w.value @ linear(image.dac), linear(x), atol=1e-12)


def _bad(what: str) -> Image:
    image = even(5)
    if what == "flagged":
        image.usable[:] = False
    elif what == "few":
        image.usable[2:] = False
    elif what == "line":
        image = Image(np.column_stack([np.arange(9.0), 2 * np.arange(9.0)]), (1, 9))
    elif what == "one place":
        image = Image(np.zeros((5, 2)))
    elif what == "differing":
        image.dac[7] = image.dac[3]
        image.velocity[7] = 1e-3
    return image


@methods
@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("flagged", "view left: all 25 pixels are flagged; scan it again or leave it out"),
        ("few", "view left: 2 of 25 pixels are usable, but interpolation needs 3 at least"),
        ("line", "view left: its 9 usable pixels all lie on one line of DAC steps"),
        ("one place", "view left: its 1 usable pixels all lie on one line of DAC steps"),
        ("differing", r"view left: pixels 3 and 7 both stand at the DAC steps \(-500, 250\), but"),
    ],
)
def test_bad_images(what: str, message: str, method: Interpolation) -> None:
    with pytest.raises(UserError, match=message):
        method.prepare(_bad(what))


def test_methods_by_name() -> None:
    interpolators: dict[str, type[Interpolator]] = {
        "linear": LinearInterpolator,
        "cubic": CubicInterpolator,
    }
    assert {m.value for m in Interpolation} == {"auto", *interpolators}
    for name, kind in interpolators.items():
        assert type(Interpolation(name).prepare(even(5))) is kind


def waving(image: Image, noise: float = 0.0) -> Image:
    """An image of a smooth wave, with noise."""
    rng, n = np.random.default_rng(7), len(image.dac)
    image.velocity = (smooth(image.dac) + noise * rng.normal(size=(n, 2)) @ [1, 1j])[:, None]
    image.std = np.full(n, max(noise, 1e-12))
    return image


@pytest.mark.one_in(4)
@cases
def test_auto_takes_cubic_where_it_predicts_pixels_better(kind: str) -> None:
    make = KINDS[kind][0]
    assert Interpolation.auto.chosen([waving(make(21))]) is Interpolation.cubic
    assert Interpolation.auto.chosen([waving(make(21), noise=3.0)]) is Interpolation.linear
    assert type(Interpolation.auto.prepare(waving(make(21)))) is CubicInterpolator
    # All images count: the clear one decides where the other tells nothing.
    both = [waving(make(21)), waving(make(15), noise=0.05)]
    assert Interpolation.auto.chosen(both) is Interpolation.cubic


class Fixed(Image):
    """An image that stays as it is."""

    __eq__, __hash__ = object.__eq__, object.__hash__


def test_the_choice_and_its_error_are_told_by_the_same_predictions(monkeypatch):
    """Of an image that cannot change pixels are predicted once by each interpolation."""
    changing = waving(even(21))
    known = [getattr(changing, f.name) for f in fields(changing)]
    image, asked = Fixed(*known), []

    def counted(*what):
        asked.append(what[2])
        return predictions(*what)

    monkeypatch.setattr(ways, "predictions", counted)
    again = Interpolation.auto.mean_error(image), Interpolation.auto.mean_error(image)
    assert asked == [LinearInterpolator, CubicInterpolator]
    expected = Interpolation.auto.mean_error(changing)
    assert all((found != expected).nnz == 0 for found in again)
    assert len(asked) == 5
    # Those of a large image would take half as much memory as all else of it.
    monkeypatch.setattr(ways, "CACHE_BYTES", 0)
    large = Fixed(*known)
    assert (Interpolation.auto.mean_error(large) != expected).nnz == 0
    assert len(asked) == 8


def test_auto_of_too_few_pixels_is_linear() -> None:
    assert Interpolation.auto.chosen([waving(even(2))]) is Interpolation.linear
    assert Interpolation.linear.mean_error(waving(even(2))).nnz == 0
    assert Interpolation.linear.mean_error(waving(scattered(2))).nnz == 0


@pytest.mark.whole
@cases
@methods
def test_mean_error_is_what_interpolation_is_off_by_around_a_pixel(
    kind: str, method: Interpolation
) -> None:
    n = 31
    image = waving(KINDS[kind][0](n))
    found = (method.mean_error(image) @ image.velocity)[:, 0].real
    inner = np.flatnonzero((np.abs(image.dac) < 250).all(axis=1))
    half = 500 / (n - 1)
    around = np.random.default_rng(2).uniform(-half, half, (400, 2))
    x = (image.dac[inner][:, None] + around).reshape(-1, 2)
    off = method.prepare(image).at(x).value @ image.velocity[:, 0].real - smooth(x)
    true = off.reshape(len(inner), -1).mean(axis=1)
    ratio = np.sqrt(np.mean(found[inner] ** 2) / np.mean(true**2))
    # Scattered pixels stand at distances that differ; whole steps and obliqueness count for little.
    low, high = (0.7, 1.6) if kind == "scattered" else (0.9, 1.4)
    assert low < ratio < high
    assert np.corrcoef(found[inner], true)[0, 1] > (0.5 if kind == "scattered" else 0.95)


@methods
def test_flagged_pixels_have_no_part_in_predictions(method: Interpolation) -> None:
    image = even(15)
    image.usable[[40, 41, 100]] = False
    waving(image)
    matrix = method.mean_error(image)
    assert matrix[:, [40, 41, 100]].nnz == 0
    assert matrix[[40, 41, 100]].nnz == 0
    assert np.abs(matrix @ np.ones(len(image.dac))).max() < 1e-12


@pytest.mark.whole
def test_auto_stays_linear_where_its_error_is_lost_in_the_noise() -> None:
    """Cubic has more work and passes more of the noise on."""
    image = waving(even(121), noise=3e-2)
    assert is_negligible([image], [predictions(image, mesh_of(image), LinearInterpolator)], 1 / 6)
    assert Interpolation.auto.chosen([image]) is Interpolation.linear
    clear = waving(even(121), noise=1e-4)
    assert Interpolation.auto.chosen([clear]) is Interpolation.cubic


def with_dropped(kind: str, dropped: list[tuple[int, int]]) -> Image:
    whole = KINDS[kind][0](21)
    flags = np.zeros(whole.shape, bool)
    flags[tuple(np.transpose(dropped))] = True
    image = Image(whole.dac, whole.shape, flags.ravel())
    image.dropped = flags.ravel()
    return image


ALONE = [(5, 5), (9, 9), (9, 10), (12, 4), (0, 8)]


@pytest.mark.parametrize("kind", ["even", "rounded", "oblique"])
@methods
def test_neighbours_stand_in_for_single_pixels(kind: str, method: Interpolation) -> None:
    """Also for two side by side and at the border; what is known of them has no say."""
    image = with_dropped(kind, ALONE)
    w = method.prepare(image).at(image.dac[image.dropped])
    assert found(w).all()
    np.testing.assert_allclose(w.value @ quadratic(image.dac), quadratic(image.dac[image.dropped]))
    assert not np.isin(w.value.indices, np.flatnonzero(image.dropped)).any()
    assert (w.value.power(2).sum(axis=1) <= 1.0 + 1e-9).all()


HOLES = {"a block": [(i, j) for i in (4, 5, 6) for j in (4, 5, 6)], "the corner": [(0, 0)]}
HOLES["a block and what hangs on it"] = [*HOLES["a block"], (7, 7), (8, 7)]


@pytest.mark.parametrize("hole", HOLES)
@methods
def test_nothing_stands_in_for_a_hole(hole: str, method: Interpolation) -> None:
    image = with_dropped("even", HOLES[hole])
    assert method.prepare(image).at(image.dac[image.dropped]).flagged.all()


@methods
def test_nothing_stands_in_for_pixels_with_other_flags(method: Interpolation) -> None:
    image = with_dropped("even", ALONE)
    image.dropped[:] = False
    assert method.prepare(image).at(image.dac[~image.usable]).flagged.all()


@pytest.mark.parametrize("kind", ["even", "scattered"])
def test_places_that_touch_some_pixels(kind: str) -> None:
    image = KINDS[kind][0](21)
    step = 2 * HALF / 20
    some = np.zeros(len(image.dac), bool)
    some[8 * 21 + 8] = True
    near, far = image.dac[some], image.dac[some] + 2.5 * step
    assert mesh_of(image).touches(np.concatenate([near, far]), some).tolist() == [True, False]


@pytest.mark.parametrize("n", [5, 90])
def test_weights_take_half_the_bytes_of_wide_indices(n: int) -> None:
    """Of one block of places and of several, as every sample of a field has its weights."""
    image = even(9)
    places = np.random.default_rng(3).uniform(-0.9 * HALF, 0.9 * HALF, (n * n, 2))
    value = Interpolation.cubic.prepare(image).at(places).value
    assert value.indices.dtype == value.indptr.dtype == np.int32
    assert value.data.nbytes == 2 * value.indices.nbytes
