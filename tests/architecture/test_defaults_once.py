"""A default stands in its dataclass alone: configuration files give only what differs from it."""

from __future__ import annotations

import pytest
from repeated_defaults import configuration_files, repeated_defaults

from sldvexp.config.paths import conf_dir


@pytest.mark.whole
def test_configuration_files_give_only_what_differs():
    repeated = [
        f"{file.relative_to(conf_dir())}: {key}"
        for file in configuration_files(conf_dir())
        for key in repeated_defaults(file)
    ]
    assert repeated == []


#: Files that build on the program's own, and the keys that they need not give.
REPEATING = {
    "volume/mine.yaml": (
        "defaults: [schema/grid@_here_, _self_]\n"
        "layers: 7\nthickness: 0.02\ncenter: [0.0, 0.0, 0.0]\nradius: null\ndepth: []\n"
        "sight: {grazing: 75, occlusion: true}\n",
        ["layers", "center", "radius", "depth", "sight.grazing"],
    ),
    "reconstruction/mine.yaml": (
        "defaults: [absolute_full, _self_]\nmodel: full\nrows: all\nweights: equal\n",
        ["model", "rows"],
    ),
    "scene/mine.yaml": (
        "defaults: [plate, _self_]\n"
        "views: {'1': {euler: [0.1, 0.2, 0.3], unit: m}, '6': {origin: [1, 2, 3], unit: m}}\n"
        "plate: {modes: {other: {x: 1, damping: 0.01}, another: {x: 3, damping: 0.01}}}\n"
        "vibrometer: {noise: 0.005, hum: 0.002}\n",
        [
            "views.1.unit",
            "views.6.unit",
            "plate.modes.other.damping",
            "plate.modes.another.damping",
            "vibrometer.noise",
            "vibrometer.hum",
        ],
    ),
    "experiment/mine.yaml": (
        "# @package _global_\n"
        "defaults: [point, _self_, override /solver: direct]\n"
        "seed: 0\n"
        "instrument: {path: conf://data/point_example.csv, positive: towards}\n"
        "reconstruction: {rows: best}\n"
        "compare: {full: {plugin: combined, model: full, rows: best}}\n"
        "check: {repeats: {plugin: pose_repeats, repeats: 1000}}\n"
        "expect: {determined: {tolerance: 0, at_least: {point@components: 3}}}\n",
        [
            "seed",
            "instrument.path",
            "instrument.positive",
            "compare.full.rows",
            "check.repeats.repeats",
            "expect.determined.tolerance",
            "expect.determined.at_least.point@components",
        ],
    ),
}


@pytest.mark.one_in(4)
@pytest.mark.parametrize("name", REPEATING)
def test_a_value_that_the_file_need_not_give_is_found(name, tmp_path):
    content, keys = REPEATING[name]
    file = tmp_path / name
    file.parent.mkdir()
    file.write_text(content)
    group = name.partition("/")[0]
    expected = keys if group == "experiment" else [f"{group}.{key}" for key in keys]
    assert repeated_defaults(file, tmp_path) == expected


def test_a_preset_may_return_to_the_default_of_the_plugin(tmp_path):
    file = tmp_path / "laser/coarse.yaml"
    file.parent.mkdir()
    file.write_text("defaults: [ometron_16bit, _self_]\nboard: bits_12_sign\n")
    assert repeated_defaults(file, tmp_path) == []
