"""Every variable of a run: dimensions, unit, meaning, and how people read it.

One place holds these facts; those of checks stand in `sldvexp.dataset.examined`.
`sldvexp.dataset.group` gives them to a stage's arrays, so that they stand in ``run.nc``; tables,
figures, pages and exports take headings and factors from here, as in
``VARIABLES["pose"]["s"].titled()``. A new variable is a line in its group.
"""

from __future__ import annotations

from sldvexp.dataset.examined import EXAMINED
from sldvexp.dataset.variable import DAC, Variable

_V = Variable

#: Coordinates that mean the same in every group.
AXES: dict[str, tuple[str, ...]] = {
    "axis": ("x", "y", "z"),
    "laser_axis": ("x", "y", "z"),
    "component": ("x", "y", "z"),
    "mirror": ("up_down", "left_right"),
    "angle_index": ("phi1", "phi2", "phi3"),
}

CONVENTIONS = {
    "amplitude_convention": "peak",
    "time_convention": "exp(+i omega t)",
    "phase_reference": "reference channel",
    "line_of_sight_convention": "positive towards the instrument",
    "euler_convention": "x-convention (z-x'-z'')",
}

#: Dimensions of a field's velocities and of a surface's strains.
_FIELD = "node component [frequency]"
_STRAIN = "place strain_component [frequency]"

#: Variables of the stages of a run, and of what checks and expectations leave, by group.
VARIABLES: dict[str, dict[str, Variable]] = {
    "target": {
        "position": _V("point axis", "m", "position of the object's points"),
        "position_std": _V("point axis", "m", "standard error of the position"),
    },
    "registration": {
        "object_point": _V("view point axis", "m", "position of the point on the object"),
        "object_point_std": _V("view point axis", "m", "standard error of that position"),
        "angle": _V("view point mirror", "rad", "mirror angle that points the beam there"),
        "dac": _V("view point mirror", "1", "DAC step of that angle", DAC),
        "used": _V("view point", "1", "1 where the view has the point, and its pose rests on it"),
    },
    "conic": {
        "coefficient": _V(
            "view circle term", "1", "coefficients A to F of the circle's image, A + B = 1"
        ),
        "bitangent": _V(
            "view bitangent_point mirror", "1", f"bitangent point of two images, {DAC}", DAC
        ),
        "registered": _V("bitangent_point", "1", "number in the registration; 0 if not used"),
        "touched": _V("bitangent_point", "", "circle, pair and line of the point"),
    },
    "edge": {
        "dac": _V("edge mirror", "1", f"edge of a circle on a scan line, {DAC}", DAC),
        "dac_std": _V("edge", "1", f"its standard error along the scan line, {DAC}", DAC),
        "direction": _V("edge mirror", "1", "unit vector along the scan line"),
        "width": _V("edge", "1", f"width of the edge's profile along the scan line, {DAC}", DAC),
        "reach": _V("edge side", "1", f"how far back and on pixels place the edge, {DAC}", DAC),
        "growth_std": _V(
            "edge mirror", "1", f"how far errors of uneven motion move a circle's edges, {DAC}", DAC
        ),
        "phase": _V("edge", "rad", "phase of the motion on the scan line", "deg"),
        "circle": _V("edge", "1", "which rough centre the line belongs to"),
    },
    "image": {
        "velocity": _V("pixel [frequency]", "m/s", "velocity along the line of sight"),
        "velocity_std": _V(
            "pixel [frequency]", "m/s", "its standard error, per real and imaginary part"
        ),
        "uncorrected": _V("pixel [frequency]", "m/s", "velocity before the phase correction"),
        "refined_frequency": _V("[frequency]", "Hz", "frequency as the reference channel has it"),
        "refined_frequency_std": _V("[frequency]", "Hz", "its standard error"),
        "angle": _V("pixel mirror", "rad", "mirror angle of the pixel", "deg"),
        "dac": _V("pixel mirror", "1", "DAC step of that angle", DAC),
        "flags": _V("pixel", "1", "what is wrong with the pixel; 0 for a good one"),
        "f_statistic": _V("pixel channel", "1", "F of the record's constant against none"),
        "f_p_value": _V("pixel channel", "1", "probability of such an F without a constant"),
        "harmonics": _V("pixel channel", "1", "how many harmonics of the record are fitted"),
        "harmonic_p_value": _V(
            "pixel channel harmonic", "1", "probability of such an F without that harmonic"
        ),
        "reference_amplitude": _V(
            "[frequency]", "V", "amplitude of the reference to which the velocity belongs"
        ),
        "coherence": _V(
            "pixel [frequency]", "1", "share of the response that is the reference's, g^2"
        ),
        "records": _V("pixel", "1", "good records behind the pixel"),
        "left_out": _V("pixel fault", "1", "records that have the fault and were left out"),
        "scale_std": _V(
            "[frequency]", "1", "standard error of a factor that all pixels of a mode share"
        ),
        "phase_std": _V(
            "[frequency]", "rad", "standard error of a phase that all pixels of a mode share"
        ),
    },
    "modes": {
        "natural_frequency": _V("mode", "Hz", "natural frequency: modulus of the pole over 2 pi"),
        "natural_frequency_std": _V("mode", "Hz", "its standard error"),
        "damping_ratio": _V("mode", "1", "damping over critical"),
        "damping_ratio_std": _V("mode", "1", "its standard error"),
        "pole_covariance": _V(
            "pole_parameter pole_parameter2",
            "1",
            "covariance of ln natural frequency of all modes, then of ln damping ratio",
        ),
        "scale_std": _V("mode", "1", "standard error of a factor of the mode's whole shape"),
        "phase_std": _V("mode", "rad", "standard error of the phase of the mode's whole shape"),
        "mixing_std": _V(
            "part mode mode2",
            "1",
            "standard error of the share of the second mode in the first's shape",
        ),
        "shape_change": _V(
            "part pole_parameter mode",
            "1",
            "share of the parameter's mode that enters the mode's shape, per unit of its error",
        ),
        "complexity": _V("mode", "1", "1 - modal phase collinearity; 0 if all moves in phase"),
        "complexity_std": _V("mode", "1", "its standard error"),
        "phase": _V("mode", "rad", "phase of the mode at resonance against the reference", "deg"),
        "reference": _V(
            "", "V", "amplitude of the reference that modal velocities are for, if it is known"
        ),
        "modal_scale": _V(
            "mode", "m/s", "r.m.s. velocity of all pixels at resonance, per unit of the reference"
        ),
        "modal_scale_std": _V("mode", "m/s", "its standard error"),
        "participation": _V(
            "exciter mode", "1", "response of the mode to the reference over that of its shape"
        ),
        "participation_std": _V("exciter mode", "1", "its standard error, of each part"),
        "misfit": _V(
            "", "1", "variance of what the modes leave over, over that of noise and harmonics"
        ),
        "misfit_dof": _V("", "1", "real degrees of freedom behind it"),
        "misfit_p_value": _V("", "1", "probability of such a misfit if only noise is left over"),
        "misfit_by_line": _V("line", "1", "the same of each line"),
        "line_frequency": _V("line", "Hz", "frequency of the measured line"),
        "noise_ratio": _V("", "1", "noise found beside the signals, over the stated one"),
        "measured_rms": _V("line", "m/s", "r.m.s. velocity of all pixels"),
        "synthesis_rms": _V("line", "m/s", "the same of the modes"),
        "residual_rms": _V("line", "m/s", "the same of measured minus synthesised"),
        "noise_rms": _V("line", "m/s", "r.m.s. stated noise of all pixels, of both parts"),
        "harmonics_rms": _V(
            "line", "m/s", "r.m.s. of the harmonics of other lines, as they are allowed for"
        ),
        "harmonic_ratio": _V(
            "harmonic", "1", "r.m.s. of a line's harmonic over the line, found in other lines"
        ),
        "candidate_order": _V("candidate", "1", "order of the fit that has the pole"),
        "candidate_frequency": _V("candidate", "Hz", "its natural frequency"),
        "candidate_damping": _V("candidate", "1", "its damping ratio"),
        "candidate_stable": _V("candidate", "1", "1 where the order below has it too"),
        "candidate_mode": _V("candidate", "1", "number of its mode; 0 of none"),
    },
    "model": {
        "pair": _V("mode", "1", "number of the model's mode that is this one; 0 of none"),
        "measured_frequency": _V("mode", "Hz", "measured natural frequency"),
        "measured_frequency_std": _V("mode", "Hz", "its standard error"),
        "model_frequency": _V("model_mode", "Hz", "natural frequency of the model"),
        "model_frequency_std": _V(
            "model_mode", "Hz", "its standard uncertainty from tolerances and mesh"
        ),
        "difference": _V("mode", "1", "ln of measured over the model's frequency"),
        "mac": _V("mode model_mode", "1", "MAC over all pixels, weighted by their noise"),
        "mac_of_pair": _V("mode", "1", "MAC with the paired mode"),
        "mac_expected": _V("mode", "1", "its expected value if the model is right"),
        "mac_std": _V("mode", "1", "its standard deviation then"),
        "scale": _V("mode", "m/s", "modal velocity per m of the model's shape"),
        "scale_std": _V("mode", "m/s", "its standard error, per real and imaginary part"),
        "imaginary_share": _V("mode", "1", "imaginary part of the scale over its modulus"),
        "chi2": _V("mode", "1", "weighted squares of measured minus the model's shape"),
        "dof": _V("mode", "1", "their degrees of freedom"),
        "p_value": _V("mode", "1", "probability of such a chi2 if the shape is right"),
        "directed_chi2": _V("mode", "1", "part of it that other shapes of the model explain"),
        "directed_dof": _V("mode", "1", "its degrees of freedom"),
        "directed_p_value": _V("mode", "1", "probability of such a part if the shape is right"),
        "mixed": _V("mode model_mode", "1", "share of the model's other modes in the measured one"),
        "mixed_std": _V("mode model_mode", "1", "its standard error, per part"),
        "modal_mass": _V(
            "mode", "kg", "modal mass for a shape that is 1 where the model moves most"
        ),
        "modal_mass_std": _V("mode", "kg", "its standard error"),
        "shapes_p_value": _V("", "1", "probability of the chi2 of all shapes, poses in common"),
        "shapes_directed_p_value": _V("", "1", "the same of the directed part"),
        "frequencies_chi2": _V("", "1", "squares of all differences over their covariance"),
        "frequencies_p_value": _V("", "1", "probability of such squares if the model is right"),
        "common_difference": _V("", "1", "difference of all frequencies in common"),
        "common_difference_std": _V("", "1", "its standard uncertainty, tolerances included"),
        "common_p_value": _V("", "1", "probability of such a difference if the model is right"),
        "sensitivity": _V("model_mode parameter", "1", "d ln frequency / d ln parameter"),
        "tolerance": _V("parameter", "1", "relative standard uncertainty of the parameter"),
        "unseen": _V(
            "parameter", "1", "relative error of the parameter below which it stays unseen"
        ),
        "factor": _V("adjusted", "1", "factor on the parameter that fits the frequencies"),
        "factor_std": _V("adjusted", "1", "its relative standard error"),
        "factor_covariance": _V("adjusted adjusted2", "1", "covariance of ln of the factors"),
        "adjusted_value": _V("adjusted", "as the parameter", "parameter that fits"),
        "adjusted_value_std": _V("adjusted", "as the parameter", "its standard error"),
        "adjusted_p_value": _V("", "1", "probability of what the adjusted model leaves"),
        "line_frequency": _V("line", "Hz", "frequency of the measured line"),
        "csac": _V("line", "1", "CSAC: measured against the model's response over all pixels"),
        "csac_expected": _V("line", "1", "its expected value under noise alone"),
        "csac_std": _V("line", "1", "its standard deviation then"),
    },
    "model/shape": {
        "position": _V("node axis", "m", "node of the surface seen, in the world"),
        "triangle": _V("triangle corner", "1", "nodes of the elements and their halves, from 0"),
        "shape": _V("node component shape_mode", "m", "mode shape of the model there"),
        "velocity": _V("node component paired_mode", "m/s", "measured mode expanded to the node"),
        "velocity_std": _V("node component paired_mode", "m/s", "its standard error, per part"),
    },
    "model/image": {
        "velocity": _V("pixel paired_mode", "m/s", "the model's mode, scaled to the measured one"),
        "residual": _V("pixel paired_mode", "m/s", "measured minus that"),
        "position": _V("pixel axis", "m", "where the beam meets the model"),
        "comac": _V("pixel", "1", "CoMAC over the paired modes"),
        "comac_expected": _V("pixel", "1", "its expected value under noise alone"),
        "comac_std": _V("pixel", "1", "its standard deviation then"),
        "frac": _V("pixel", "1", "FRAC: measured against the model's response over all lines"),
        "frac_expected": _V("pixel", "1", "its expected value under noise alone"),
        "frac_std": _V("pixel", "1", "its standard deviation then"),
    },
    "pose": {
        "origin": _V("view axis", "m", "origin of the laser frame in the world"),
        "origin_std": _V("view axis", "m", "standard error of the origin"),
        "origin_confidence": _V("view axis", "m", "half-width of the origin's interval"),
        "rotation": _V("view laser_axis axis", "1", "rotation from world to laser axes"),
        "euler": _V("view angle_index", "rad", "Euler angles, world to laser", "deg"),
        "euler_std": _V("view angle_index", "rad", "standard error of the Euler angles"),
        "euler_confidence": _V("view angle_index", "rad", "half-width of the angles' interval"),
        "covariance": _V("view parameter parameter2", "m and rad", "covariance of the pose"),
        "joint_covariance": _V(
            "unknown unknown2", "m, 1 and rad", "covariance of all views' poses together"
        ),
        "intrinsic": _V("view adjusted", "m, 1 and rad", "adjusted intrinsic parameter"),
        "intrinsic_std": _V("view adjusted", "m, 1 and rad", "its standard error"),
        "intrinsic_confidence": _V("view adjusted", "m, 1 and rad", "half-width of its interval"),
        "residual": _V(
            "view point mirror", "1", f"observed minus predicted, {DAC}", DAC, "residual"
        ),
        "residual_rms": _V(
            "view", "1", f"root mean square of the residuals, {DAC}", DAC, "residual r.m.s."
        ),
        "s": _V("view", "1", f"standard deviation of a mirror reading, {DAC}", DAC, "s"),
        "pointing_std": _V(
            "view", "1", f"pointing noise of the mirrors, {DAC}", DAC, "pointing noise"
        ),
        "rough_centre": _V("view circle", "1", "which rough centre shows the circle"),
        "s_deg": _V("view", "deg", "standard deviation of a mirror reading"),
        "rim": _V("view", "m", "by how much edges are seen outside of their circles"),
        "sse": _V("view", "deg2", "sum of the squared residuals"),
        "cost": _V("view", "1", "what was minimised, squared DAC steps", "squared DAC steps"),
        "dof": _V("view", "1", "degrees of freedom of the covariance", label="dof"),
        "other_origin": _V("view axis", "m", "origin of the other, worse solution"),
        "other_rotation": _V("view laser_axis axis", "1", "rotation of the other solution"),
        "other_cost": _V("view", "1", "cost of the other solution"),
        "other_found": _V("view", "1", "1 where a second solution exists"),
    },
    "volume": {
        "mesh": _V("", "1", "topology of the volume, a mesh of triangular prisms"),
        "position": _V("node axis", "m", "position of the nodes, layer by layer"),
        "node_x": _V("node", "m", "x of the node"),
        "node_y": _V("node", "m", "y of the node"),
        "node_z": _V("node", "m", "z of the node"),
        "node_layer": _V("node", "1", "layer of the node, from 0"),
        "element": _V("element corner", "1", "nodes of the prism, from 0; three below and above"),
        "element_shape": _V("element", "1", "shape of the element"),
        "depth": _V("layer", "m", "depth of the layer along the normals; 0 is the given surface"),
        "frame": _V("surface_node local_axis axis", "1", "tangents and normal, unit vectors"),
        "sample_parameter": _V("sample_point parameter", "1", "where samples lie in every prism"),
    },
    "line_of_sight": {
        "direction_cosines": _V("view [point] axis", "1", "unit vector surface to instrument"),
        "velocity": _V("view [point] [frequency]", "m/s", "velocity along the line of sight"),
        "velocity_std": _V(
            "view [point] [frequency]", "m/s", "its standard error, per real and imaginary part"
        ),
        "flags": _V("view [point] [frequency]", "1", "1 where nothing was measured"),
        "position": _V("point axis", "m", "position of the point"),
        "triangle": _V("triangle corner", "1", "indices of points that a surface joins"),
        "line": _V("line end", "1", "indices of points that a line joins"),
    },
    "point": {
        "velocity": _V("[point] component [frequency]", "m/s", "velocity"),
        "velocity_std": _V("[point] component [frequency]", "m/s", "its standard error"),
        "confidence": _V("[point] component [frequency]", "m/s", "half-width of its interval"),
        "intercept": _V("[point] [frequency]", "m/s", "intercept of the full model"),
        "intercept_std": _V("[point] [frequency]", "m/s", "its standard error"),
        "f_statistic": _V("[point] [frequency]", "1", "F of the intercept against none"),
        "f_p_value": _V("[point] [frequency]", "1", "probability of such an F without intercept"),
        "residual": _V("row [frequency]", "m/s", "measured minus predicted, of a single point"),
        "matrix": _V("unknown unknown2", "1", "the matrix that is solved, of a single point"),
        "sse": _V("[point] [frequency]", "m2/s2", "sum of the squared residuals"),
        "s": _V("[point] [frequency]", "m/s", "noise of one real component of a view"),
        "dof": _V("[point] [frequency]", "1", "real degrees of freedom behind s"),
        "chi2_p_value": _V("[point] [frequency]", "1", "probability of such residuals"),
        "rcond": _V("[point]", "1", "reciprocal condition number in the 1-norm"),
        "hadamard": _V("[point]", "1", "Hadamard condition number"),
        "efficiency": _V("[point] component [frequency]", "1", "Gauss-Markov bound over variance"),
        "observable": _V("[point] component", "1", "1 where the views determine the component"),
        "basis": _V("[point] row axis", "1", "contravariant basis vectors"),
        "deficient_point": _V("deficient", "1", "index of a point whose views are deficient"),
        "observed_rank": _V("deficient", "1", "how many of its directions are determined"),
        "observed_direction": _V(
            "deficient direction axis", "1", "orthonormal; the first of them are determined"
        ),
        "observed_velocity": _V(
            "deficient direction [frequency]", "m/s", "velocity along the determined directions"
        ),
        "observed_velocity_std": _V("deficient direction [frequency]", "m/s", "its standard error"),
        "observed_confidence": _V(
            "deficient direction [frequency]", "m/s", "half-width of its interval"
        ),
    },
    "truth": {
        "velocity": _V("node component [frequency]", "m/s", "true velocity of the surface nearby"),
        "height": _V("node", "m", "height of the node above the true surface"),
        "position": _V("node axis", "m", "position of the node"),
        "strain": _V("place strain_component [frequency]", "1", "true strain of the surface"),
    },
    "field": {
        "velocity": _V(_FIELD, "m/s", "velocity"),
        "velocity_std": _V(_FIELD, "m/s", "its standard error, of the larger part"),
        "confidence": _V(_FIELD, "m/s", "half-width of its interval, of the larger part"),
        "velocity_std_noise": _V(_FIELD, "m/s", "standard error from the pixels' noise"),
        "velocity_std_pose": _V(_FIELD, "m/s", "standard error from the poses, of the larger part"),
        "velocity_std_poles": _V(
            _FIELD, "m/s", "standard error from frequency and damping of the modes, of modes alone"
        ),
        "velocity_std_by_part": _V(f"part {_FIELD}", "m/s", "standard error of each part"),
        "confidence_by_part": _V(f"part {_FIELD}", "m/s", "half-width of each part's interval"),
        "variance": _V(
            f"source {_FIELD}",
            "m2/s2",
            "variance from each source, of the larger part; they add up to that of velocity_std",
        ),
        "element_error": _V(_FIELD, "m/s", "estimated error that the elements' size adds"),
        "interpolation_error": _V(
            _FIELD,
            "m/s",
            "estimated error that interpolation between pixels adds",
        ),
        "intercept": _V("node [frequency]", "m/s", "intercept of the full model"),
        "intercept_std": _V("node [frequency]", "m/s", "its standard error, of the larger part"),
        "position": _V("node axis", "m", "position of the nodes, layer by layer"),
        "element": _V("element corner", "1", "nodes of the prism, from 0; three below and above"),
        "observable": _V("node component", "1", "1 where the views determine the component"),
        "flagged_node": _V("flagged", "1", "node where not all components are determined"),
        "flagged_rank": _V("flagged", "1", "how many of its directions are determined"),
        "flagged_direction": _V(
            "flagged direction component", "1", "orthonormal; the first of them are determined"
        ),
        "efficiency": _V("node component", "1", "Gauss-Markov bound over variance"),
        "sse": _V("equation [frequency]", "m2/s2", "sum of the squared residuals"),
        "residual_std": _V("equation [frequency]", "m/s", "root of sse over samples"),
        "s": _V("equation [frequency]", "m/s", "residual std of a real component, unbiased"),
        "chi2_ratio": _V("equation [frequency]", "1", "sse over its expectation from the noise"),
        "residual_std_by_view": _V(
            "view [frequency]", "m/s", "rms residual of the view", label="r.m.s. residual"
        ),
        "residual_std_by_row": _V("row [frequency]", "m/s", "rms residual of the method's row"),
        "f_statistic": _V("[frequency]", "1", "F of the intercepts against none"),
        "f_p_value": _V("[frequency]", "1", "probability of such an F without intercepts"),
        "samples_seen": _V("view", "1", "samples that the view sees"),
        "samples_lost": _V("view reason", "1", "samples that it does not see, by the reason"),
    },
    "strain": {
        "strain": _V(_STRAIN, "1", "strain of the face"),
        "strain_std": _V(_STRAIN, "1", "its standard error, of the larger part"),
        "strain_std_by_part": _V(f"part {_STRAIN}", "1", "standard error of each part"),
        "confidence": _V(_STRAIN, "1", "half-width of its interval, larger part"),
        "middle_strain": _V(_STRAIN, "1", "strain of the middle, that of the membrane"),
        "middle_strain_std": _V(_STRAIN, "1", "its standard error"),
        "middle_confidence": _V(_STRAIN, "1", "half-width of its interval, larger part"),
        "bending_strain": _V(_STRAIN, "1", "strain of bending, (face - back) / 2"),
        "bending_strain_std": _V(_STRAIN, "1", "its standard error"),
        "bending_confidence": _V(_STRAIN, "1", "half-width of its interval, larger part"),
        "back_strain": _V(_STRAIN, "1", "strain of the back"),
        "back_strain_std": _V(_STRAIN, "1", "its standard error"),
        "back_confidence": _V(_STRAIN, "1", "half-width of its interval, larger part"),
        "principal_strain": _V(
            "place principal [frequency]",
            "1",
            "largest extension of the face over a cycle and all directions, and the strain across",
        ),
        "principal_strain_std": _V(
            "place principal [frequency]", "1", "its standard error at most"
        ),
        "principal_confidence": _V(
            "place principal [frequency]", "1", "half-width of its interval at most"
        ),
        "principal_direction": _V(
            "place [frequency]", "deg", "direction of the largest extension, from t1 towards t2"
        ),
        "principal_direction_std": _V(
            "place [frequency]", "deg", "its standard error at most; 52 where it is unknown"
        ),
        "principal_phase": _V("place [frequency]", "rad", "moment of the largest extension", "deg"),
        "stress": _V(_STRAIN, "Pa", "plane stress of the face"),
        "stress_std": _V(_STRAIN, "Pa", "its standard error, of the larger part"),
        "von_mises": _V(
            "place [frequency]", "Pa", "von Mises stress of the face, largest of a cycle"
        ),
        "von_mises_std": _V("place [frequency]", "Pa", "its standard error at most"),
        "von_mises_confidence": _V("place [frequency]", "Pa", "half-width of its interval at most"),
        "membrane_force": _V(_STRAIN, "N/m", "membrane force N per width"),
        "membrane_force_std": _V(_STRAIN, "N/m", "its standard error, of the larger part"),
        "bending_moment": _V(_STRAIN, "N", "bending moment M per width"),
        "bending_moment_std": _V(_STRAIN, "N", "its standard error, of the larger part"),
        "position": _V("place axis", "m", "position of the places on the given surface"),
        "coordinate": _V("place surface_axis", "m", "the same along the surface, as of gages"),
        "frame": _V("place local_axis axis", "1", "t1, t2 and the normal, unit vectors"),
        "triangle": _V("triangle corner", "1", "places of each triangle, from 0"),
    },
    "verdict": {
        "kind": _V("finding", "", "kind of mistake"),
        "subject": _V("finding", "", "view, point, circle or pixels that it is about"),
        "severity": _V("finding", "", "note, doubtful or void"),
        "statistic": _V("finding", "1", "of the test that found it"),
        "p_value": _V("finding", "1", "probability of such a statistic without the mistake"),
        "size": _V("finding", "1", "how large it is, in the unit of the text"),
        "remedy": _V("finding", "", "setting that would repair it"),
        "views": _V("finding", "", "names of the views that it is about, as JSON; [] of none"),
        "text": _V("finding", "", "the finding in a sentence"),
    },
    "check": {
        "published": _V("quantity", "as the quantity", "published or demanded value"),
        "computed": _V("quantity", "as the quantity", "value of this run"),
        "correct": _V("quantity", "as the quantity", "value by the correct formula"),
        "tolerance": _V("quantity", "as the quantity", "largest accepted difference"),
        "relation": _V("quantity", "", "how computed must stand to published"),
        "passed": _V("quantity", "1", "1 where the run keeps it"),
        "source": _V("quantity", "", "where the published value stands"),
    },
    **EXAMINED,
}
