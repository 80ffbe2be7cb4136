"""Variables that checks leave in a run, by ``examined/<plugin>``."""

from __future__ import annotations

from sldvexp.dataset.variable import DAC, Variable

_V = Variable

#: Variables of every check, by the group's name with its plugin's.
EXAMINED: dict[str, dict[str, Variable]] = {
    "examined/bitangents": {
        "position_inch": _V("point plane_axis", "inch", "bitangent point in its circles' plane"),
    },
    "examined/cross_ratio": {
        "up_down": _V("kind", "1", "cross-ratio of the up-down mirror's planes"),
        "left_right": _V("kind", "1", "cross-ratio of the left-right mirror's planes"),
    },
    "examined/equilibrium": {
        "place_s": _V("patch", "m", "middle of the patch, along the surface's first direction"),
        "place_t": _V("patch", "m", "middle of the patch, along its second direction"),
        "pressure": _V("patch frequency", "Pa", "mean pressure that the motion asks for"),
        "pressure_std_by_part": _V("part patch frequency", "Pa", "its standard error, by part"),
        "acted": _V("patch frequency", "1", "1 where forces act"),
        "p_value": _V("patch frequency", "1", "probability of such a pressure without forces"),
        "wave_ratio": _V("frequency", "1", "rho h / D over the material's, as waves show it"),
        "wave_ratio_std": _V("frequency", "1", "its standard error, with the material's"),
        "loss_factor": _V("frequency", "1", "loss factor of the patches without forces"),
        "loss_factor_std": _V("frequency", "1", "its standard error"),
        "p_whole": _V("frequency", "1", "probability of such residuals if nothing acts"),
    },
    "examined/equivalent_methods": {
        "difference": _V("component [frequency]", "m/s", "the other method's velocity minus this"),
        "inside": _V("component [frequency]", "1", "1 where the other is within the intervals"),
        "f_statistic": _V("component [frequency]", "1", "F of the difference against none"),
        "f_critical": _V("component [frequency]", "1", "critical value of F"),
        "f_p_value": _V("component [frequency]", "1", "probability of such an F without one"),
        "reject": _V("component [frequency]", "1", "1 where the two differ significantly"),
    },
    "examined/field_pattern": {
        "std_ratio": _V("field component", "1", "r.m.s. standard error over the out-of-plane one"),
        "residual_ratio": _V("field component", "1", "residual std over the out-of-plane one"),
        "view_ratio": _V("field view", "1", "residual std of a view over the median view's"),
        "cond_ratio": _V("field", "1", "condition number of the chosen field over this one's"),
    },
    "examined/faces": {
        "lever_arm": _V("", "m", "lever arm of the slopes between face and back"),
        "lever_arm_std": _V("", "m", "its standard error"),
        "distance": _V("", "m", "thickness, which it should be"),
        "p_arm": _V("", "1", "probability of such a lever arm if it is"),
        "chi_square": _V("", "1", "of low-order differences of both sides against none"),
        "freedom": _V("", "1", "its degrees of freedom"),
        "p_difference": _V("", "1", "probability of such differences without any"),
        "p_beside": _V("", "1", "probability of such differences, whatever the lever arm"),
        "component_p_value": _V(
            "component", "1", "probability of such differences of one component"
        ),
    },
    "examined/gages": {
        "strain": _V("gage [frequency]", "1", "predicted strain along the gage, over its grid"),
        "confidence": _V("gage [frequency]", "1", "half-width of its interval, of the larger part"),
        "confidence_by_part": _V(
            "part gage [frequency]", "1", "half-width of its interval, of each part"
        ),
        "measured": _V("gage [frequency]", "1", "strain that the gage showed"),
        "measured_std": _V("gage [frequency]", "1", "its standard uncertainty, of each part"),
        "difference": _V("gage [frequency]", "1", "measured minus predicted strain"),
        "difference_confidence": _V(
            "part gage [frequency]", "1", "half-width of its interval, of each part"
        ),
        "p_value": _V("gage [frequency]", "1", "probability of such a difference by chance"),
        "agrees": _V("gage [frequency]", "1", "1 where the difference is no surprise"),
        "true_strain": _V("gage [frequency]", "1", "strain that the virtual lab's plate has there"),
    },
    "examined/image_truth": {
        "bias": _V("view frequency", "1", "common factor by which pixels are off", label="bias"),
        "bias_std": _V("view frequency", "1", "its standard error, of each part"),
        "covered": _V(
            "view frequency", "1", "share of the intervals that hold the truth", label="covered"
        ),
        "largest_bias": _V("view", "1", "largest bias at a line where more moves than beside it"),
        "covered_in_all": _V("view", "1", "share covered of all lines"),
        "flagged": _V("view", "1", "share of the pixels that are flagged"),
    },
    "examined/kreis": {
        "rcond": _V("method", "1", "reciprocal condition number in the 1-norm"),
        "hadamard": _V("method", "1", "Hadamard condition number"),
        "judged": _V("method", "1", "1 where there are as many rows as unknowns"),
        "meets_by_rcond": _V("method", "1", "1 where the reciprocal number is above the limit"),
        "meets_by_hadamard": _V("method", "1", "1 where the Hadamard number is above the limit"),
    },
    "examined/middle_surface": {
        "place_s": _V("patch", "m", "middle of the patch, along the surface's first direction"),
        "place_t": _V("patch", "m", "middle of the patch, along its second direction"),
        "by_layers": _V("patch", "m", "height of least kinetic energy over the middle as given"),
        "by_layers_std": _V("patch", "m", "its standard error"),
        "by_lever_arm": _V("patch", "m", "height of the middle by the lever arm of the slopes"),
        "by_lever_arm_std": _V("patch", "m", "its standard error"),
    },
    "examined/needed_components": {
        "f_statistic": _V("[frequency]", "1", "F of the components against none"),
        "f_critical": _V("[frequency]", "1", "critical value of F"),
        "f_p_value": _V("[frequency]", "1", "probability of such an F without them"),
        "reject": _V("[frequency]", "1", "1 where the components are significant"),
    },
    "examined/phase_image": {
        "phase": _V("view stage frequency", "rad", "mean phase, but for half a turn"),
        "phase_std": _V("view stage frequency", "rad", "circular standard deviation of phases"),
        "p_uniform": _V("view stage frequency", "1", "p-value of phases that are uniform"),
    },
    "examined/pose_equivalence": {
        "difference": _V("view quantity", "rad and m", "this pose minus the other"),
        "t": _V("view quantity", "1", "Welch's t' of the difference"),
        "dof": _V("view quantity", "1", "Welch-Satterthwaite degrees of freedom"),
        "t_critical": _V("view quantity", "1", "critical value at those degrees of freedom"),
        "t_critical_whole_dof": _V("view quantity", "1", "critical value, degrees rounded down"),
        "reject": _V("view quantity", "1", "1 where the two poses differ significantly"),
    },
    "examined/pose_methods": {
        "views": _V("pose_method", "1", "how many poses the method found"),
        "s_mean": _V(
            "pose_method", "1", f"mean of s, the error estimate of a pose, {DAC}", DAC, "s"
        ),
        "s_std": _V("pose_method", "1", f"its sample standard deviation, {DAC}", DAC, "std"),
        "origin_error": _V(
            "pose_method",
            "m",
            "root mean square distance from the true origin",
            label="origin off by",
        ),
        "rotation_error": _V(
            "pose_method", "rad", "root mean square angle to the true axes", "deg", "axes by"
        ),
    },
    "examined/pose_repeats": {
        "std_ratio": _V("view parameter", "1", "std of simulated repeats over the reported one"),
        "coverage": _V("view parameter", "1", "fraction of intervals that hold the truth"),
    },
    "examined/power_flow": {
        "place_s": _V("patch", "m", "middle of the patch, along the surface's first direction"),
        "place_t": _V("patch", "m", "middle of the patch, along its second direction"),
        "intensity": _V("patch direction frequency", "W/m", "power through a line of unit length"),
        "intensity_std": _V("patch direction frequency", "W/m", "its standard error"),
        "leaves": _V("patch frequency", "W", "power that leaves the patch's window"),
        "leaves_std": _V("patch frequency", "W", "its standard error"),
        "dissipated": _V("patch frequency", "W", "power that damping takes in the window"),
        "fed": _V("force frequency", "W", "power that the force puts in"),
        "fed_std": _V("force frequency", "W", "its standard error"),
        "found": _V("force frequency", "W", "power that leaves or is lost around the force"),
        "found_std": _V("force frequency", "W", "its standard error"),
    },
    "examined/repeatability": {
        "dac_std": _V(
            "point mirror", "1", f"standard deviation of repeated image points, {DAC}", DAC
        ),
        "largest": _V("", "1", f"the largest of them, {DAC}", DAC),
    },
    "examined/surface_depth": {
        "depth": _V("", "m", "depth of least tangential motion: the middle of the real shell"),
        "depth_std": _V("", "m", "its standard error"),
        "agreement_depth": _V("", "m", "depth at which the views agree best"),
        "agreement_depth_std": _V("", "m", "its standard error"),
        "misfit": _V("sample_depth", "1", "squared residuals over their expectation from noise"),
    },
    "examined/left_out": {
        "error": _V("view", "m/s", "r.m.s. of measured minus predicted velocity"),
        "measured": _V("view", "m/s", "r.m.s. of the measured velocity"),
        "noise": _V("view", "m/s", "r.m.s. noise of the measured velocity, as stated"),
        "expected": _V("view", "m/s", "that of a view that is right, from noise and poses"),
        "p_value": _V("view", "1", "probability of such a view if it is right, by three tests"),
        "named": _V("view", "1", "1 where the verdict names the view, or one of two, as wrong"),
    },
    "examined/lever_arm": {
        "lever_arm": _V("frequency", "m", "lever arm of the slopes, under bending alone"),
        "lever_arm_std": _V("frequency", "m", "its standard error"),
        "confidence": _V("frequency", "m", "half-width of its interval"),
        "stated": _V("", "m", "half the thickness, which it should be"),
        "stated_std": _V("", "m", "standard uncertainty of it and of the height given"),
        "wave_number": _V("frequency", "rad/m", "wave number of the bending"),
        "beside_membrane": _V(
            "frequency", "m", "lever arm with low motions of the middle let free"
        ),
        "beside_membrane_std": _V("frequency", "m", "its standard error"),
        "chi_square": _V(
            "bending_part frequency", "1", "of low motions of the middle against none"
        ),
        "p_value": _V("bending_part frequency", "1", "probability of such a one without any"),
        "offset": _V("", "m", "lever arm minus the stated one, at long waves"),
        "offset_std": _V("", "m", "its standard error"),
        "shear": _V("", "1", "part of the slope that shear takes at the shortest waves"),
        "shear_std": _V("", "1", "its standard error"),
        "p_love": _V("", "1", "probability of such motion of the middle in phase, without any"),
        "p_arm": _V("", "1", "probability of such lever arms if they are as stated"),
        "p_membrane": _V(
            "", "1", "probability of such motion of the middle, whatever the lever arm"
        ),
    },
    "examined/love": {
        "variation": _V("component [frequency]", "1", "r.m.s. change through the layers over size"),
        "bound": _V("component [frequency]", "1", "r.m.s. half-width of the intervals over size"),
    },
    "examined/strain_truth": {
        "relative_error": _V(
            "strain_component [frequency]",
            "1",
            "r.m.s. error over the true r.m.s.",
            label="relative error",
        ),
        "rms_error": _V(
            "strain_component [frequency]",
            "1",
            "r.m.s. error of the strain",
            label="r.m.s. error",
        ),
        "rms_bound": _V(
            "strain_component [frequency]",
            "1",
            "r.m.s. half-width of the intervals",
            label="bound",
        ),
        "covered": _V(
            "strain_component [frequency]",
            "1",
            "share of the intervals that hold the truth",
            label="covered",
        ),
        "relative_error_in_all": _V(
            "strain_component", "1", "relative error of all frequencies together"
        ),
        "covered_in_all": _V("strain_component", "1", "share covered of all frequencies"),
        "peak": _V("[frequency]", "1", "strain where the truth's is highest, along its direction"),
        "peak_confidence": _V("[frequency]", "1", "half-width of its interval, of both parts"),
        "true_peak": _V("[frequency]", "1", "highest principal strain of the truth"),
        "peak_covered": _V("[frequency]", "1", "1 where the interval of the peak holds the truth"),
        "concentration": _V("[frequency]", "1", "peak over the r.m.s. of the principal strain"),
        "true_concentration": _V("[frequency]", "1", "concentration of the truth"),
    },
    "examined/modal_truth": {
        "found": _V("true_mode", "1", "1 where the true mode was found"),
        "missed_modes": _V("", "1", "true modes within the band that were not found"),
        "false_modes": _V("", "1", "modes that are none"),
        "natural_frequency_error": _V("true_mode", "1", "error of the frequency over the truth"),
        "damping_ratio_error": _V("true_mode", "1", "error of the damping ratio over the truth"),
        "covered": _V("", "1", "share of the poles' intervals of 95 % that hold the truth"),
        "mac": _V("true_mode component", "1", "modal assurance criterion with the true shape"),
        "shape_error": _V("true_mode component", "1", "r.m.s. error over the true r.m.s."),
        "shape_covered": _V("true_mode component", "1", "share of intervals that hold the truth"),
    },
    "examined/truth": {
        "relative_error": _V(
            "component [frequency]",
            "1",
            "r.m.s. error over the true r.m.s.",
            label="relative error",
        ),
        "rms_error": _V(
            "component [frequency]",
            "m/s",
            "r.m.s. error on the true surface",
            label="r.m.s. error",
        ),
        "rms_bound": _V(
            "component [frequency]", "m/s", "r.m.s. half-width of the intervals", label="bound"
        ),
        "covered": _V(
            "component [frequency]",
            "1",
            "share of the intervals that hold the truth",
            label="covered",
        ),
        "relative_error_in_all": _V("component", "1", "relative error of all frequencies together"),
        "covered_in_all": _V("component", "1", "share of the intervals of all frequencies"),
    },
    "examined/printed": {
        "linpack_rcond": _V("method", "1", "reciprocal condition number as LINPACK estimates it"),
        "std": _V("method", "m/s", "sample standard deviation of the residuals"),
        "half_width": _V("method component", "m/s", "1.96 s v_ii, as printed"),
        "f_statistic": _V("[frequency]", "1", "F of the intercept by the printed convention"),
        "f_critical": _V("", "1", "critical F by that convention's degrees of freedom"),
    },
}
