"""A script that opens the exported period in ParaView, warped, coloured and ready to play.

ParaView tells a script where it lies if it is loaded as a state, and pvpython does; both were tried
with 5.11.
"""

from __future__ import annotations

from string import Template

import numpy as np

from sldvexp.export.motion import amplitude, drawn_scale
from sldvexp.export.velocities import PrismMesh
from sldvexp.typing import ComplexArray

#: ParaView 5.10 gave "Threshold" the settings that this uses.
SCRIPT = Template('''\
"""Opens the period in ParaView 5.10 or later: File, Load State, or paraview --state=<this file>."""

import os

from paraview import simple

FOLDER = os.path.dirname(os.path.abspath(__file__))
# Drawn deflection over the $vector in the file.
SCALE = $scale
# Largest velocity, m/s.
LARGEST = $largest

period = simple.PVDReader(registrationName="period", FileName=os.path.join(FOLDER, $file))
known = simple.Threshold(registrationName="determined", Input=period)
known.Scalars = ["POINTS", "determined"]
known.LowerThreshold = 0.5
known.UpperThreshold = 1.5
moved = simple.WarpByVector(registrationName="moved", Input=known)
moved.Vectors = ["POINTS", "$vector"]
moved.ScaleFactor = SCALE

view = simple.GetActiveViewOrCreate("RenderView")
rest = simple.Show(period, view)
rest.SetRepresentationType("Feature Edges")
shown = simple.Show(moved, view)
shown.SetRepresentationType("Surface")
simple.ColorBy(shown, ("POINTS", "velocity", "Magnitude"))
colours = simple.GetColorTransferFunction("velocity")
colours.ApplyPreset("Viridis (matplotlib)", True)
colours.RescaleTransferFunction(0.0, LARGEST)
shown.SetScalarBarVisibility(view, True)
bar = simple.GetScalarBar(colours, view)
bar.Title = "velocity now, m/s"
bar.ComponentTitle = ""

scene = simple.GetAnimationScene()
scene.UpdateAnimationUsingDataTimeSteps()
scene.PlayMode = "Snap To TimeSteps"
scene.Loop = 1
view.CameraPosition = $eye
view.CameraFocalPoint = $middle
view.CameraViewUp = [0.0, 0.0, 1.0]
view.ResetCamera()
simple.SetActiveSource(moved)
simple.Render()
''')
#: From where the shape is seen, as on the report's page.
TOWARD = (-0.41, -0.76, 0.5)


def paraview_script(name: str, mesh: PrismMesh, velocity: ComplexArray, hertz: float | None) -> str:
    """Write the script.

    Parameters
    ----------
    name : str
        Of the export, without suffix.
    velocity : ndarray of complex, shape (node, 3), m/s
        Of the frequency that is played, along the world's axes.
    hertz : float, optional
        None if the run does not know it; the velocity is then drawn as a deflection.
    """
    known = np.nan_to_num(velocity)
    scale = drawn_scale(mesh.position, known)
    middle = (mesh.position.min(axis=0) + mesh.position.max(axis=0)) / 2
    return SCRIPT.substitute(
        file=ascii(f"{name}_phase.pvd"),
        vector="displacement" if hertz else "velocity",
        scale=scale * 2 * np.pi * hertz if hertz else scale,
        largest=float(amplitude(known).max()) or 1.0,
        eye=(middle + np.array(TOWARD)).round(6).tolist(),
        middle=middle.round(6).tolist(),
    )
