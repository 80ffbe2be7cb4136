"""Stresses of a thin sheet from the strains of its surface: plane stress, isotropic.

    s_ss = E (e_ss + nu e_tt) / (1 - nu^2)    s_tt = E (e_tt + nu e_ss) / (1 - nu^2)
    s_st = E e_st / (1 + nu)

Von Mises' stress changes over a cycle; with s(phi) = Re(s exp(i phi)) and the quadratic form
``q(s) = s_ss^2 - s_ss s_tt + s_tt^2 + 3 s_st^2`` its square is a constant and a part of twice the
frequency, so that its largest value is

    max_phi q(s(phi)) = (s^H Q s + |s^T Q s|) / 2.
"""

from __future__ import annotations

import numpy as np

from sldvexp.shell.material import Isotropic
from sldvexp.typing import Array, ComplexArray

#: Von Mises' quadratic form of the components ss, tt, st.
VON_MISES = np.array([[1.0, -0.5, 0.0], [-0.5, 1.0, 0.0], [0.0, 0.0, 3.0]])


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
    ss, tt, st = np.moveaxis(strain, 1, 0)
    plane = E / (1 - nu**2)
    return np.stack([plane * (ss + nu * tt), plane * (tt + nu * ss), E / (1 + nu) * st], axis=1)


def stress_std(strain: ComplexArray, std: Array, material: Isotropic) -> Array:
    """Bound the stresses' standard errors, of the strains' and of the material's.

    How strains of one place go together is not known here, so that their errors are added as if
    they did in the least favourable way.

    Parameters
    ----------
    strain : ndarray of complex, shape (place, 3, frequency)
    std : ndarray, shape (place, 3, frequency)

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.shell import Isotropic
    >>> from sldvexp.shell.material import Tolerance
    >>> sheet = Isotropic(0.003, E=70e9, nu=0.0, tolerance=Tolerance(E=7e9))
    >>> strain = np.array([[[3e-6], [0], [0]]], complex)
    >>> stress_std(strain, np.array([[[4e-7], [0], [0]]]), sheet)[0, 0].round().tolist()
    [35000.0]
    """
    e, nu, known = material.E, material.nu, material.tolerance
    ss, tt, st = np.moveaxis(std, 1, 0)
    plane = e / (1 - nu**2)
    own = [plane * (ss + abs(nu) * tt), plane * (tt + abs(nu) * ss), e / (1 + nu) * st]
    here, step = plane_stress(strain, e, nu), 1e-6
    by_nu = (plane_stress(strain, e, nu + step) - here) / step
    of_material = np.abs(here * known.E / e) ** 2 + np.abs(by_nu * known.nu) ** 2
    return np.asarray(np.sqrt(np.stack(own, axis=1) ** 2 + of_material))


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
