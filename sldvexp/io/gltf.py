"""glTF 2.0's binary file (GLB): a mesh that moves, told by morph targets and their weights in time.

A vertex is at p + w_1 d_1 + w_2 d_2 + ..., where the targets d are its displacements and all
vertices share the weights w. Players join the weights of the instants by straight lines. Vertices
share one buffer of 32-bit numbers; colours are linear light, which sRGB is not.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.typing import Array, IntArray

#: glTF's modes of primitives by their number of corners: points, lines, triangles.
MODES = {1: 0, 2: 1, 3: 4}
#: Its types of numbers, and of elements by their size.
NUMBERS = {"f4": 5126, "u4": 5125, "u2": 5123}
ELEMENTS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
#: What buffers of vertices and of their numbers in primitives are for.
VERTICES, CORNERS = 34962, 34963
#: Marks of the file, of its text, and of its numbers.
MAGIC, VERSION, TEXT, BINARY = 0x46546C67, 2, 0x4E4F534A, 0x004E4942
#: A quarter turn about x: z, which a run's figures have upwards, becomes glTF's y.
UPRIGHT = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]
#: Seen from both sides, and without gloss, which would look like motion.
MATERIAL = {
    "doubleSided": True,
    "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9},
}


def glb(
    position: Array,
    cells: Sequence[IntArray],
    targets: Mapping[str, Array],
    colour: Array,
    time: Array,
    weights: Array,
    name: str,
    extras: Mapping[str, Any],
) -> bytes:
    """Write a mesh that moves.

    Parameters
    ----------
    position : ndarray, shape (vertex, 3), m
        z is upwards.
    cells : sequence of ndarray of int, shape (cell, corner)
        Vertices from 0: points, lines, triangles.
    targets : mapping of str to ndarray, shape (vertex, 3), m
        Displacements by the names of their targets.
    colour : ndarray, shape (vertex, 3)
        Red, green and blue of sRGB, 0 to 1.
    time : ndarray, shape (instant,), s
        Ascending from 0.
    weights : ndarray, shape (instant, target)
    name : str
        Of the mesh and its motion.
    extras : mapping of str to anything that JSON has
        What the numbers mean.

    Examples
    --------
    >>> corner, up = np.eye(3), np.zeros((3, 3)) + [0, 0, 0.1]
    >>> sine = np.sin(np.linspace(0, 2 * np.pi, 5))[:, None]
    >>> made = glb(corner, [np.arange(3)[None]], {"up": up}, corner, np.arange(5.0), sine, "t", {})
    >>> made[:4], len(made) % 4
    (b'glTF', 0)
    """
    numbers = _Numbers()
    vertices = {"POSITION": numbers.put(position.astype("<f4"), VERTICES, limits=True)}
    light = np.column_stack([_linear(colour), np.ones(len(colour))])
    shade = np.rint(light * np.iinfo(np.uint16).max).astype("<u2")
    vertices["COLOR_0"] = numbers.put(shade, VERTICES, normalized=True)
    moved = [
        {"POSITION": numbers.put(away.astype("<f4"), VERTICES, limits=True)}
        for away in targets.values()
    ]
    primitives = [
        {
            "attributes": vertices,
            "indices": numbers.put(own.astype("<u4").ravel(), CORNERS),
            "targets": moved,
            "material": 0,
            "mode": MODES[own.shape[1]],
        }
        for own in cells
    ]
    sampler = {
        "input": numbers.put(time.astype("<f4"), limits=True),
        "output": numbers.put(weights.astype("<f4").ravel()),
        "interpolation": "LINEAR",
    }
    channel = {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    mesh = {
        "name": name,
        "primitives": primitives,
        "weights": weights[0].tolist(),
        "extras": {**extras, "targetNames": list(targets)},
    }
    return numbers.file(
        {
            "asset": {"version": "2.0", "generator": "sldvexp"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"name": name, "mesh": 0, "rotation": UPRIGHT}],
            "meshes": [mesh],
            "materials": [MATERIAL],
            "animations": [{"name": name, "samplers": [sampler], "channels": [channel]}],
        }
    )


class _Numbers:
    """The one buffer of a file, and what of it is which array."""

    def __init__(self) -> None:
        self.buffer = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def put(
        self, values: NDArray, use: int = 0, limits: bool = False, normalized: bool = False
    ) -> int:
        """Append an array, and give the number that the text calls it by."""
        data = np.ascontiguousarray(values).tobytes()
        view = {"buffer": 0, "byteOffset": len(self.buffer), "byteLength": len(data)}
        self.views.append(view | ({"target": use} if use else {}))
        self.buffer += data + bytes(-len(data) % 4)
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": NUMBERS[values.dtype.str[1:]],
            "count": len(values),
            "type": ELEMENTS[1 if values.ndim == 1 else values.shape[1]],
        }
        if limits:
            low, high = (np.atleast_1d(f(axis=0)).tolist() for f in (values.min, values.max))
            accessor |= {"min": low, "max": high}
        self.accessors.append(accessor | ({"normalized": True} if normalized else {}))
        return len(self.accessors) - 1

    def file(self, text: dict[str, Any]) -> bytes:
        """Join the text and the buffer, each in a chunk whose length four divides."""
        text |= {
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.buffer)}],
        }
        told = json.dumps(text, allow_nan=False, separators=(",", ":")).encode()
        told += b" " * (-len(told) % 4)
        chunks = b""
        for kind, data in ((TEXT, told), (BINARY, bytes(self.buffer))):
            chunks += np.array([len(data), kind], "<u4").tobytes() + data
        return np.array([MAGIC, VERSION, 12 + len(chunks)], "<u4").tobytes() + chunks


def _linear(colour: Array) -> Array:
    """Turn values of sRGB into the linear ones that glTF has (IEC 61966-2-1)."""
    return np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
