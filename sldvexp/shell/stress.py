"""Stresses and force resultants of a thin sheet, isotropic, in plane stress.

    s = C e,   C = E / (1 - nu^2) [[1, nu, 0], [nu, 1, 0], [0, 0, 1 - nu]]

with e = (e_ss, e_tt, e_st), the tensor's shear. Strain grows evenly through the thickness h, from
that of the middle, e_0, by that of bending, e_b = (face - back) / 2 at h/2, so that

    N = h C e_0 (N/m),    M = h^2/6 C e_b (N m/m):

a positive moment pulls the face. With e_b = -h/2 (w,ss, w,tt, w,st) it is ``M_ss = -D (w,ss +
nu w,tt)``, D = E h^3 / (12 (1 - nu^2)). Where the sheet is curved, parts of the order of thickness
over radius are left out.

Von Mises' stress changes over a cycle; with s(phi) = Re(s exp(i phi)) and the quadratic form
``q(s) = s_ss^2 - s_ss s_tt + s_tt^2 + 3 s_st^2 = s' Q s`` its square is a constant and a part of
twice the frequency, so that its largest value is

    max_phi q(s(phi)) = (s^H Q s + |s^T Q s|) / 2   at   phi = -arg(s^T Q s) / 2.

Errors ds change it by ``s(phi)' Q Re(ds exp(i phi))`` over itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.shell.material import Isotropic
from sldvexp.typing import Array, ComplexArray

#: Von Mises' quadratic form of the components ss, tt, st.
VON_MISES = np.array([[1.0, -0.5, 0.0], [-0.5, 1.0, 0.0], [0.0, 0.0, 3.0]])
#: Step of the difference by which results are differentiated by Poisson's ratio.
STEP = 1e-6


def elasticity(E: float, nu: float) -> Array:
    """Make the matrix C of stresses from strains, Pa.

    Examples
    --------
    >>> elasticity(70e9, 0.0).diagonal().tolist()
    [70000000000.0, 70000000000.0, 70000000000.0]
    """
    return E / (1 - nu**2) * np.array([[1.0, nu, 0.0], [nu, 1.0, 0.0], [0.0, 0.0, 1 - nu]])


def plane_stress(strain: ComplexArray, E: float, nu: float) -> ComplexArray:
    """Compute stresses from strains.

    Parameters
    ----------
    strain : ndarray of complex, shape (place, 3, frequency)
        e_ss, e_tt, and the tensor's e_st.
    E : float, Pa
    nu : float

    Examples
    --------
    >>> import numpy as np
    >>> plane_stress(np.array([[[1e-6], [-0.3e-6], [0]]]), 70e9, 0.3)[0, :, 0].real.round().tolist()
    [70000.0, 0.0, 0.0]
    """
    return np.einsum("ab,pbf->paf", elasticity(E, nu), strain)


def stress_std(strain: ComplexArray, covariance: Array, material: Isotropic) -> Array:
    """Compute standard errors of stresses, of the strains' and of the material's.

    Parameters
    ----------
    strain : ndarray of complex, shape (place, 3, frequency)
    covariance : ndarray, shape (part, place, 3, 3, frequency)
        Of the strains' components, of the real and of the imaginary part.

    Returns
    -------
    ndarray, shape (place, 3, frequency), Pa
        Of the larger part.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.shell import Isotropic
    >>> from sldvexp.shell.material import Tolerance
    >>> sheet = Isotropic(0.003, E=70e9, nu=0.0, tolerance=Tolerance(E=7e9))
    >>> strain, covariance = np.zeros((1, 3, 1), complex), np.zeros((2, 1, 3, 3, 1))
    >>> strain[0, 0], covariance[0, 0, 0, 0] = 3e-6, 4e-7**2
    >>> stress_std(strain, covariance, sheet)[0, 0].round().tolist()
    [35000.0]
    """
    own = _of_stress(covariance, material).diagonal(axis1=2, axis2=3)
    own = np.moveaxis(own, -1, 2).max(axis=0)
    return with_material(
        np.sqrt(np.maximum(own, 0)), material, lambda e, nu: plane_stress(strain, e, nu)
    )


def von_mises(stress: ComplexArray) -> Array:
    """Compute the largest von Mises stress of a cycle, shape (place, frequency), Pa.

    Examples
    --------
    Tension along s, whose phase does not matter:

    >>> import numpy as np
    >>> von_mises(np.array([[[3e6 + 4e6j], [0], [0]]])).tolist()
    [[5000000.0]]
    """
    steady = np.einsum("paf,ab,pbf->pf", stress.conj(), VON_MISES, stress).real
    swinging = np.abs(np.einsum("paf,ab,pbf->pf", stress, VON_MISES, stress))
    return np.asarray(np.sqrt((steady + swinging) / 2))


def von_mises_std(strain: ComplexArray, covariance: Array, material: Isotropic) -> Array:
    """Bound standard errors of the largest von Mises stress of a cycle.

    How errors of the real and of the imaginary part go together is not known here, so that they are
    added as if they did in the least favourable way.

    Parameters
    ----------
    strain : ndarray of complex, shape (place, 3, frequency)
    covariance : ndarray, shape (part, place, 3, 3, frequency)

    Returns
    -------
    ndarray, shape (place, frequency), Pa

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.shell import Isotropic
    >>> strain, covariance = np.zeros((1, 3, 1), complex), np.zeros((2, 1, 3, 3, 1))
    >>> strain[0, 0], covariance[0, 0, 0, 0] = 3e-6, 4e-7**2
    >>> von_mises_std(strain, covariance, Isotropic(0.003, E=70e9, nu=0.0)).round().tolist()
    [[28000.0]]
    """
    stress = plane_stress(strain, material.E, material.nu)
    swinging = np.einsum("paf,ab,pbf->pf", stress, VON_MISES, stress)
    turn = np.exp(-0.5j * np.angle(swinging))
    row = np.einsum("ab,pbf->paf", VON_MISES, (stress * turn[:, None]).real)
    row /= np.maximum(von_mises(stress), np.finfo(float).tiny)[:, None]
    variance = np.einsum("paf,npabf,pbf->npf", row, _of_stress(covariance, material), row)
    own = np.sqrt(np.maximum(variance, 0)) * np.abs([turn.real, turn.imag])
    return with_material(
        own.sum(axis=0), material, lambda e, nu: von_mises(plane_stress(strain, e, nu))
    )


def with_material(
    own: Array, material: Isotropic, result: Callable[[float, float], NDArray[Any]]
) -> Array:
    """Add the material's tolerances to standard errors.

    Parameters
    ----------
    own : ndarray
        From everything else.
    result : callable
        Computes the results, of the shape of `own`, from E and nu; they grow with E.
    """
    known = material.tolerance
    here = result(material.E, material.nu)
    by_nu = (result(material.E, material.nu + STEP) - here) / STEP
    return np.sqrt(
        own**2 + np.abs(here * known.E / material.E) ** 2 + np.abs(by_nu * known.nu) ** 2
    )


def _of_stress(covariance: Array, material: Isotropic) -> Array:
    """Turn covariances of strains into those of stresses."""
    c = elasticity(material.E, material.nu)
    return np.einsum("ac,npcdf,bd->npabf", c, covariance, c)
