"""Variables of the groups that checks and expectations leave."""

from __future__ import annotations

from sldvexp.dataset.variable import Variable

_V = Variable

EXAMINED: dict[str, dict[str, Variable]] = {
    "examined/bitangents": {
        "position_inch": _V("point plane_axis", "inch", "bitangent point in its circles' plane"),
    },
    "examined/cross_ratio": {
        "up_down": _V("kind", "1", "cross-ratio of the up-down mirror's planes"),
        "left_right": _V("kind", "1", "cross-ratio of the left-right mirror's planes"),
    },
    "examined/field_pattern": {
        "std_ratio": _V("field component", "1", "r.m.s. standard error over the out-of-plane one"),
        "residual_ratio": _V("field component", "1", "residual std over the out-of-plane one"),
        "view_ratio": _V("field view", "1", "residual std of a view over the median view's"),
        "cond_ratio": _V("field", "1", "condition number of the chosen field over this one's"),
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
        "s_mean": _V("pose_method", "1", "mean of s, the error estimate of a pose, DAC steps"),
        "s_std": _V("pose_method", "1", "its sample standard deviation, DAC steps"),
        "origin_error": _V("pose_method", "m", "root mean square distance from the true origin"),
        "rotation_error": _V("pose_method", "rad", "root mean square angle to the true axes"),
    },
    "examined/pose_repeats": {
        "std_ratio": _V("view parameter", "1", "std of simulated repeats over the reported one"),
        "coverage": _V("view parameter", "1", "fraction of intervals that hold the truth"),
    },
    "examined/repeatability": {
        "dac_std": _V(
            "point mirror", "1", "standard deviation of repeated image points, DAC steps"
        ),
        "largest": _V("", "1", "the largest of them, DAC steps"),
    },
    "examined/surface_depth": {
        "depth": _V("", "m", "depth of least tangential motion: the middle of the real shell"),
        "depth_std": _V("", "m", "its standard error"),
        "agreement_depth": _V("", "m", "depth at which the views agree best"),
        "agreement_depth_std": _V("", "m", "its standard error"),
        "misfit": _V("sample_depth", "1", "squared residuals over their expectation from noise"),
    },
    "examined/left_out": {
        "error": _V("view sample_depth", "m/s", "r.m.s. of measured minus predicted velocity"),
        "error_at_surface": _V("view", "m/s", "that where the views agree best"),
        "measured": _V("view", "m/s", "r.m.s. of the measured velocity"),
        "noise": _V("view", "m/s", "r.m.s. noise of the measured velocity"),
    },
    "examined/love": {
        "variation": _V("component [frequency]", "1", "r.m.s. change through the layers over size"),
        "bound": _V("component [frequency]", "1", "r.m.s. half-width of the intervals over size"),
    },
    "examined/truth": {
        "relative_error": _V("component [frequency]", "1", "r.m.s. error over the true r.m.s."),
        "rms_error": _V("component [frequency]", "m/s", "r.m.s. error on the true surface"),
        "rms_bound": _V("component [frequency]", "m/s", "r.m.s. half-width of the intervals"),
        "covered": _V("component [frequency]", "1", "share of the intervals that hold the truth"),
        "relative_error_in_all": _V("component", "1", "relative error of all frequencies together"),
        "covered_in_all": _V("component", "1", "share of the intervals of all frequencies"),
    },
    "examined/printed": {
        "linpack_rcond": _V("method", "1", "reciprocal condition number as LINPACK estimates it"),
        "std": _V("method", "m/s", "sample standard deviation of the residuals"),
        "half_width": _V("method component", "m/s", "1.96 s v_ii, as printed"),
        "f_statistic": _V("", "1", "F of the intercept by the printed convention"),
        "f_critical": _V("", "1", "critical F with 1 and n - 1 degrees of freedom"),
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
}
