"""The fields of a result in ParaView, step by step as in docs/how_do_i.md: pvpython paraview_picture.py RESULT PNG.

Run by ParaView's own Python (written with 5.11), which knows nothing of indent-sim.
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

INK = [0.13, 0.13, 0.13]


def deformed(file: Path):
    """Steps 1, 2 and 4: open, warp by the displacement, complete what is half."""
    reader = Xdmf3ReaderS(FileName=[str(file)])
    reader.UpdatePipeline()
    warped = WarpByVector(Input=reader, Vectors=["POINTS", "displacement"], ScaleFactor=1.0)
    return Reflect(Input=warped, Plane="X Min", CopyInput=1)


def main(result: Path, picture: Path) -> None:
    view = GetActiveViewOrCreate("RenderView")
    body, tip = (deformed(result / name) for name in ("fields.xdmf", "tip.xdmf"))
    GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
    GetAnimationScene().GoToLast()
    shown = Show(body, view)  # step 3: colour
    shown.Representation = "Surface"
    ColorBy(shown, ("CELLS", "von_mises"))
    colours = GetColorTransferFunction("von_mises")
    colours.ApplyPreset("Viridis (matplotlib)", True)
    shown.RescaleTransferFunctionToDataRange(False, True)
    shown.SetScalarBarVisibility(view, True)
    shown.Ambient, shown.Diffuse = 1.0, 0.0  # colours as in the bar, whatever the light
    line = Show(tip, view)
    ColorBy(line, ("POINTS", ""))
    line.DiffuseColor = line.AmbientColor = INK
    line.LineWidth = 3.0
    bar = GetScalarBar(colours, view)
    bar.Title, bar.ComponentTitle = "von_mises", ""
    bar.TitleColor = bar.LabelColor = INK
    bar.Orientation, bar.ScalarBarLength = "Horizontal", 0.4
    bar.WindowLocation, bar.Position = "Any Location", [0.3, 0.04]
    bar.RangeLabelFormat = "%.2f"
    view.Background, view.UseColorPaletteForBackground = [1.0, 1.0, 1.0], 0
    view.OrientationAxesLabelColor = INK
    view.ViewSize = [1100, 520]
    view.CameraParallelProjection = 1
    view.CameraPosition, view.CameraFocalPoint, view.CameraViewUp = [0, -1, 0], [0, 0, 0], [0, 0, 1]
    ResetCamera(view)
    view.CameraParallelScale *= 0.5
    SaveScreenshot(str(picture), view, ImageResolution=[1100, 520])


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
