"""Draws the fields of a result with ParaView, in the steps of docs/how_do_i.md.

usage: pvpython scripts/paraview_picture.py RESULT PNG

ParaView's own Python (written with version 5.11) runs this script; it needs no part of indent-sim.
"""

import sys
from pathlib import Path

from paraview.simple import (
    ColorBy,
    GetActiveViewOrCreate,
    GetAnimationScene,
    GetColorTransferFunction,
    GetScalarBar,
    Reflect,
    ResetCamera,
    SaveScreenshot,
    Show,
    WarpByVector,
    Xdmf3ReaderS,
)

DARK_GREY = [0.13, 0.13, 0.13]


def open_deformed(file: Path):
    """Open a file, warp it by the displacement, and complete the half model (steps 1, 2 and 4)."""
    reader = Xdmf3ReaderS(FileName=[str(file)])
    reader.UpdatePipeline()
    warped = WarpByVector(Input=reader, Vectors=["POINTS", "displacement"], ScaleFactor=1.0)
    return Reflect(Input=warped, Plane="X Min", CopyInput=1)


def main(result: Path, picture: Path) -> None:
    """Draw the von Mises stress on the deformed body below the tip at the last row."""
    view = GetActiveViewOrCreate("RenderView")
    body = open_deformed(result / "fields.xdmf")
    tip = open_deformed(result / "tip.xdmf")
    GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
    GetAnimationScene().GoToLast()
    color_body(Show(body, view), view)
    tip_display = Show(tip, view)
    ColorBy(tip_display, ("POINTS", ""))
    tip_display.DiffuseColor = DARK_GREY
    tip_display.AmbientColor = DARK_GREY
    tip_display.LineWidth = 3.0
    set_camera(view)
    SaveScreenshot(str(picture), view, ImageResolution=[1100, 520])


def color_body(display, view) -> None:
    """Colour the body by the von Mises stress, and show a scalar bar (step 3)."""
    display.Representation = "Surface"
    ColorBy(display, ("CELLS", "von_mises"))
    colors = GetColorTransferFunction("von_mises")
    colors.ApplyPreset("Viridis (matplotlib)", True)
    display.RescaleTransferFunctionToDataRange(False, True)
    display.SetScalarBarVisibility(view, True)
    # Ambient light alone: the colours are those of the scalar bar.
    display.Ambient = 1.0
    display.Diffuse = 0.0
    bar = GetScalarBar(colors, view)
    bar.Title = "von_mises"
    bar.ComponentTitle = ""
    bar.TitleColor = DARK_GREY
    bar.LabelColor = DARK_GREY
    bar.Orientation = "Horizontal"
    bar.ScalarBarLength = 0.4
    bar.WindowLocation = "Any Location"
    bar.Position = [0.3, 0.04]
    bar.RangeLabelFormat = "%.2f"


def set_camera(view) -> None:
    """Look along y in parallel projection on a white background."""
    view.Background = [1.0, 1.0, 1.0]
    view.UseColorPaletteForBackground = 0
    view.OrientationAxesLabelColor = DARK_GREY
    view.ViewSize = [1100, 520]
    view.CameraParallelProjection = 1
    view.CameraPosition = [0, -1, 0]
    view.CameraFocalPoint = [0, 0, 0]
    view.CameraViewUp = [0, 0, 1]
    ResetCamera(view)
    view.CameraParallelScale *= 0.5


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
