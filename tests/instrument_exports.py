"""Text exports of ten instruments, written from their published layouts, with known moduli.

The layouts (titles, units, separators, header lines) are facts from public files and parsers:

* JPK: exports in github.com/rbensua/afmToolkit (`# columns`, `# fancyNames`, `# units`).
* NanoScope Analysis: inst/veecoFolder of the same repository, and the titles that parsers list.
* Asylum: text files of Igor, and the header that Hooke's driver of MFP-1D exports reads.
* NT-MDT: the test file of afmformats (three columns, decimal commas, DFL in nA).
* Optics11: the test file of afmformats.
* Anton Paar: the parser of semantic_transformers (line of units, segment numbers, sessions).
* Hysitron: the parser of pynida (Depth (nm), Load (µN), Time (s) in Latin-1).
* CellScale: OutputColumns of .tst files.
* Nanosurf, Park: no public file was found; stacked and paired tables with the names of channels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

# The retraction has this part of the force of the approach: mixing the two changes the modulus.
RETRACT_FORCE = 0.6
POINTS = 300


@dataclass(frozen=True)
class Measurement:
    """Approach and retraction of a paraboloid on a half-space, in um, nN and s.

    Attributes
    ----------
    modulus
        Young's modulus [kPa]; Poisson's ratio is 0.5.
    R
        Radius of the tip [um].
    stiffness
        Spring constant [nN/um]; 0 without a cantilever.
    delta, force, z, t
        Depths, forces, displacements of the base and times (n,); the approach has `turn` rows.
    """

    modulus: float
    R: float
    stiffness: float
    delta: np.ndarray
    force: np.ndarray
    z: np.ndarray
    t: np.ndarray
    turn: int

    @property
    def deflection(self) -> np.ndarray:
        """Deflection of the cantilever (n,) [um]."""
        return self.force / self.stiffness

    def rows(self, part: str) -> slice:
        """Rows of the approach or the retraction."""
        return slice(0, self.turn) if part == "approach" else slice(self.turn, None)


@dataclass(frozen=True)
class Export:
    """A file of an instrument, the scene and options of its fit, and the outcome.

    Attributes
    ----------
    instrument, way
        Which instrument, and what is unusual.
    data
        Content of the file.
    measurement
        The curve in it.
    words
        Options of the command line.
    has_spring
        Whether the scene has the cantilever.
    refusal
        Text in the reason of a refusal; "" if the curve is fitted.
    said
        Text in a warning of the fit.
    suffix
        Suffix of the file.
    """

    instrument: str
    way: str
    data: bytes
    measurement: Measurement
    words: dict[str, object] = field(default_factory=dict)
    has_spring: bool = False
    refusal: str = ""
    said: str = ""
    suffix: str = ".txt"

    @property
    def scene(self) -> dict[str, object]:
        """The scene, with a wrong modulus that all curves of an instrument share."""
        m = self.measurement
        modulus = 2.0 * 10.0 ** round(np.log10(m.modulus))
        scene: dict[str, object] = {
            "units": {"length": "um", "force": "nN"},
            "body": {"shape": "half_space"},
            "material": {"model": "linear_elastic", "E": modulus, "nu": 0.5},
            "indenter": {"shape": "paraboloid", "R": m.R},
            "loading": {"delta": 0.1 * m.R, "steps": 5},
            "output": {"plot": False},
        }
        if self.has_spring:
            scene["experiment"] = {"cantilever": {"stiffness": m.stiffness}}
        return scene


def measure(
    draw: np.random.Generator,
    modulus: float,
    R: float,
    depth: float,
    stiffness: float = 0.0,
    n: int = POINTS,
) -> Measurement:
    """Simulate a measurement with one per cent of white noise and an unknown origin."""
    delta = depth * np.linspace(-0.8, 1.0, n)
    delta = np.concatenate([delta, delta[::-1]])
    force = 4 / 3 * modulus / 0.75 * np.sqrt(R) * np.maximum(delta, 0.0) ** 1.5
    force[n:] *= RETRACT_FORCE
    z = delta + (force / stiffness if stiffness else 0.0)
    noisy = force + 0.01 * force.max() * draw.standard_normal(2 * n)
    origin = draw.uniform(1.0, 2.0) * depth
    measured_delta = z - noisy / stiffness if stiffness else z
    t = 0.01 * np.arange(2 * n)
    return Measurement(modulus, R, stiffness, measured_delta + origin, noisy, z + origin, t, n)


def table(
    columns: Sequence[np.ndarray | Sequence[str]],
    separator: str = "\t",
    decimal: str = ".",
    style: str = ".7g",
    end: str = "\n",
) -> str:
    """Rows of numbers and words."""
    lines = []
    for row in zip(*columns, strict=True):
        cells = [cell if isinstance(cell, str) else format(cell, style) for cell in row]
        if decimal == ",":
            cells = [
                cell.replace(",", "x").replace(".", ",").replace("x", ".")
                if not isinstance(value, str)
                else cell
                for cell, value in zip(cells, row, strict=True)
            ]
        lines.append(separator.join(cells) + end)
    return "".join(lines)


def exports(seed: int = 0) -> Iterator[Export]:
    """Six files of each of the ten instruments."""
    draw = np.random.default_rng(seed)
    for name, write in INSTRUMENTS.items():
        yield from write(name, draw)


def afm(draw: np.random.Generator) -> Measurement:
    """Measure with an AFM: 0.2 nm of force noise on a soft cantilever."""
    return measure(draw, draw.uniform(0.8, 1.2), 5.0, 1.0, 20.0)


# ---- JPK ----------------------------------------------------------------------------------------


def jpk_block(m: Measurement, part: str, style: str, slot: str = "force", head: bool = True) -> str:
    """Return a segment of a JPK export: header lines and rows between blanks, in SI units."""
    rows = m.rows(part)
    deflection = {
        "force": 1e-9 * m.force,
        "distance": 1e-6 * m.deflection,
        "volts": 1e-6 * m.deflection / 7.36e-8,
    }[slot][rows]
    unit = {"force": "N", "distance": "m", "volts": "V"}[slot]
    t = m.t[rows] - m.t[rows][0]
    height = 1e-6 * (60.0 - m.z[rows])
    columns = [height + 1e-6 * m.deflection[rows], deflection, height, m.t[rows], t]
    lines = [
        "# segmentIndex: 0",
        f"# segment: {'extend' if part == 'approach' else 'retract'}",
        "# columns: verticalTipPosition vDeflection strainGaugeHeight seriesTime time",
        '# fancyNames: "Vertical Tip Position" "Vertical Deflection" "Height (measured)" '
        '"Series Time" "Segment Time"',
        "# sensitivity: 7.36E-8",
        "# springConstant: 0.02",
        f"# units: m {unit} m s s",
        "#",
    ]
    if not head:
        lines = [line for line in lines if "sensit" not in line and "springC" not in line]
    return "\n".join(lines) + "\n" + table(columns, " ", style=style) + "\n"


def jpk(name: str, draw: np.random.Generator) -> Iterator[Export]:
    """JPK data processing, text export of one or more segments."""
    intro = "# xPosition: 1.0E-5\n# force-settings.relative-z-start: 5.97E-5\n#\n"

    def both(m: Measurement, slot: str = "force", head: bool = True) -> str:
        first, second = (jpk_block(m, part, ".9e", slot, head) for part in ("approach", "retract"))
        return intro + first + "\n" + intro + second

    m = afm(draw)
    yield Export(name, "stacked segments", both(m).encode(), m, said="0.02 N/m")
    m = afm(draw)
    yield Export(name, "deflection in m", both(m, "distance").encode(), m, said="force from")
    m = afm(draw)
    yield Export(name, "volts", both(m, "volts").encode(), m, said="73.6 nm/V")
    m = afm(draw)
    text = both(m, "volts", False)
    yield Export(name, "volts, no calibration", text.encode(), m, refusal="--sensitivity")
    m = afm(draw)
    yield Export(
        name,
        "retraction first",
        (jpk_block(m, "retract", ".9e") + "\n" + intro + jpk_block(m, "approach", ".9e")).encode(),
        m,
    )
    m = afm(draw)
    text = jpk_block(m, "approach", ".9e").replace("\n", "\r\n")
    yield Export(name, "one segment, line ends of Windows", text.encode(), m, suffix=".out.txt")


# ---- NanoScope Analysis -------------------------------------------------------------------------


NANOSCOPE_HEAD = (
    '"\\?Force file list"\n"\\Version: 0x07300000"\n"\\*Scanner list"\n'
    '"\\@Sens. Zsens: V 6.680000 nm/V"\n"\\*Ciao scan list"\n"\\Samps/line: 512"\n'
    '"\\@Sens. DeflSens: V 36.35000 nm/V"\n"\\@Sens. ZsensSens: V 357.6317 nm/V"\n'
    '"\\*Ciao force list"\n"\\Samps/line: 300 300"\n"\\Deflection Sensitivity Correction: 1.08"\n'
    '"\\*Ciao force image list"\n"\\Spring Constant: 0.02"\n"\\*Force file list end"\n'
)


def nanoscope(name: str, draw: np.random.Generator) -> Iterator[Export]:
    """NanoScope Analysis, Export ASCII: columns of extension and retraction side by side."""

    def paired(m: Measurement, signal: Callable[[Measurement], np.ndarray], unit: str) -> list:
        a, b = m.rows("approach"), m.rows("retract")
        values = signal(m)
        return [1e3 * m.z[a], 1e3 * m.z[b], values[a], values[b]], (
            f"Calc_Ramp_Ex_nm\tCalc_Ramp_Rt_nm\tDefl_{unit}_Ex\tDefl_{unit}_Rt\t\n"
        )

    def write(m: Measurement, unit: str, factor: float, head: str = NANOSCOPE_HEAD, **how) -> str:
        columns, titles = paired(m, lambda m: factor * m.deflection, unit)
        return head + titles + table(columns, end="\t\n", style=".6e", **how)

    m = afm(draw)
    yield Export(name, "pN", write(m, "pN", 1e3 * m.stiffness).encode(), m, said="0.02 N/m")
    m = afm(draw)
    yield Export(name, "nm", write(m, "nm", 1e3).encode(), m, said="force from")
    m = afm(draw)
    yield Export(name, "volts", write(m, "V", 1e3 / 36.35).encode(), m, said="36.35 nm/V")
    m = afm(draw)
    yield Export(
        name, "nm, no header", write(m, "nm", 1e3, "").encode(), m, has_spring=True, said="scene"
    )
    m = afm(draw)
    text = write(m, "V", 1e3 / 36.35, "")
    yield Export(name, "volts, no header", text.encode(), m, {"sensitivity": "36.35 nm/V"}, True)
    m = afm(draw)
    # Time, height of a sensor that falls, and a retraction that is shorter.
    a, b = m.rows("approach"), m.rows("retract")
    columns = [m.t[a], m.t[b], -1e3 * m.z[a], -1e3 * m.z[b], 1e3 * m.force[a], 1e3 * m.force[b]]
    titles = (
        "Time_s_Ex\tTime_s_Rt\tHeight_Sensor_nm_Ex\tHeight_Sensor_nm_Rt\tDefl_pN_Ex\tDefl_pN_Rt\t\n"
    )
    lines = table(columns, end="\t\n", style=".6e").splitlines()
    for k in range(-40, 0):
        cells = lines[k].split("\t")
        lines[k] = "\t".join([cells[0], "", cells[2], "", cells[4], "", ""])
    text = NANOSCOPE_HEAD + titles + "\n".join(lines) + "\n"
    yield Export(name, "sensor that falls", text.encode(), m, suffix=".spm.txt")


# ---- Asylum -------------------------------------------------------------------------------------


def asylum(name: str, draw: np.random.Generator) -> Iterator[Export]:
    """Asylum Research: waves of Igor as text, with the wave note or without."""
    note = "SpringConstant: 0.02\nInvOLS: 5.1e-08\nScanRate: 1.0\nVelocity: 1e-06\n"

    def igor(m: Measurement, columns: list, titles: str) -> str:
        rows = table(columns, "\t", style=".8e")
        body = "".join(f"\t{line}\n" for line in rows.splitlines())
        return f'IGOR\nWAVES/D\t{titles}\nBEGIN\n{body}END\nX SetScale/P x 0,1,"", ZSnsr\n'

    m = afm(draw)
    columns = [1e-6 * m.z, 1e-6 * m.deflection]
    text = note + "ZSnsr (m)\tDefl (m)\n" + table(columns, style=".8e")
    yield Export(name, "wave note", text.encode(), m, said="force from")
    m = afm(draw)
    columns = [1e-6 * m.z, 1e-9 * m.force]
    text = "ZSnsr [m],Force [N]\n" + table(columns, ",", style=".8e")
    yield Export(name, "csv of forces", text.encode(), m, has_spring=True, suffix=".csv")
    m = afm(draw)
    text = (
        note + "ZSnsr (m)\tDeflV\n" + table([1e-6 * m.z, 1e-6 * m.deflection / 5.1e-8], style=".8e")
    )
    yield Export(name, "volts", text.encode(), m, said="51 nm/V")
    m = afm(draw)
    text = igor(m, [1e-6 * m.z, 1e-6 * m.deflection], "ZSnsr\tDefl")
    yield Export(
        name, "Igor text, no units", text.encode(), m, refusal="has no unit", suffix=".itx"
    )
    m = afm(draw)
    text = igor(m, [1e-6 * m.z, 1e-6 * m.deflection], "ZSnsr\tDefl")
    units = {"units": {"length": "m", "deflection": "m"}}
    yield Export(name, "Igor text", text.encode(), m, units, True, suffix=".itx")
    m = afm(draw)
    text = (
        note
        + "Separation (m)\tForce (N)\n"
        + table([-1e-6 * m.delta, 1e-9 * m.force], decimal=",", style=".8e")
    )
    yield Export(name, "separation, decimal comma", text.encode(), m, said="separation")


# ---- Nanosurf -----------------------------------------------------------------------------------


def nanosurf(name: str, draw: np.random.Generator) -> Iterator[Export]:
    """Nanosurf: stacked tables of the forward and the backward ramp."""

    def write(
        m: Measurement,
        columns: list,
        titles: str,
        separator: str = ";",
        decimal: str = ".",
        heads: tuple[str, str] = ("Spec forward", "Spec backward"),
    ) -> str:
        text = "Nanosurf\n"
        for part, head in zip(("approach", "retract"), heads, strict=True):
            rows = [column[m.rows(part)] for column in columns]
            text += f"\n{head}\n{titles}\n" + table(rows, separator, decimal, ".8e")
        return text

    m = afm(draw)
    text = write(m, [-1e-6 * m.z, 1e-9 * m.force], "Z-Axis [m];Deflection [N]")
    yield Export(name, "stacked tables", text.encode(), m, has_spring=True)
    m = afm(draw)
    text = write(m, [1e-6 * m.z, 1e-6 * m.deflection], "Z-Axis Sensor [m];Deflection [m]")
    yield Export(name, "deflection in m", text.encode(), m, has_spring=True, said="force from")
    m = afm(draw)
    text = write(m, [1e-6 * m.z, 1e-6 * m.deflection / 8e-8], "Z-Axis [m];Deflection [V]")
    yield Export(name, "volts", text.encode(), m, {"sensitivity": "80 nm/V"}, True)
    m = afm(draw)
    text = write(m, [m.z, m.force], "Z-Achse [µm];Kraft [nN]", ";", ",")
    yield Export(
        name,
        "German, decimal comma",
        text.encode("latin-1"),
        m,
        {"columns": ("z=1", "force=2")},
        True,
    )
    m = afm(draw)
    text = write(m, [1e-6 * m.z, 1e-6 * m.deflection], "Z-Axis [m];Deflection [m]")
    yield Export(name, "no stiffness", text.encode(), m, refusal="experiment.cantilever.stiffness")
    m = afm(draw)
    text = write(m, [1e3 * m.z, m.force], "Z-Axis;Deflection\nnm;nN", ";", ",")
    yield Export(name, "line of units", text.encode(), m, has_spring=True)


# ---- Park ---------------------------------------------------------------------------------------


def park(name: str, draw: np.random.Generator) -> Iterator[Export]:
    """Park: columns of the forward and the backward ramp, with two lines below the titles."""

    def paired(m: Measurement, *values: np.ndarray) -> list:
        return [value[m.rows(part)] for part in ("approach", "retract") for value in values]

    m = afm(draw)
    head = "Force Constant (N/m): 0.02\n\n"
    titles = "Z Scan Forward\tForce Forward\tZ Scan Backward\tForce Backward\n"
    text = head + titles + "um\tnN\tum\tnN\n" + table(paired(m, m.z, m.force))
    yield Export(name, "line of units", text.encode(), m, said="0.02 N/m")
    m = afm(draw)
    text = (
        head
        + titles
        + "[um]\t[nN]\t[um]\t[nN]\n(raw)\t(raw)\t(raw)\t(raw)\n\neoh\n"
        + table(paired(m, m.z, m.force))
    )
    yield Export(name, "two lines, a blank one and a mark", text.encode(), m)
    m = afm(draw)
    titles = "Index,Z Detector(um),Force(nN),Time(ms)\n"
    text = titles + table([np.arange(600), m.z, m.force, 1e3 * m.t], ",")
    yield Export(name, "index and time", text.encode(), m, has_spring=True, suffix=".csv")
    m = afm(draw)
    order = np.argsort(m.z, kind="stable")
    rows = [column[order] for column in (m.z, m.force, 1e3 * m.t)]
    text = "Z Detector(um),Force(nN),Time(ms)\n" + table(rows, ",", style=".9g")
    yield Export(name, "sorted by z", text.encode(), m, has_spring=True, said="sorted by time")
    m = afm(draw)
    text = "Z Scan(um)\tA-B(V)\n" + table([m.z, m.deflection / 0.08], decimal=",")
    yield Export(name, "volts, decimal comma", text.encode(), m, {"sensitivity": "80 nm/V"}, True)
    m = afm(draw)
    text = "Z Scan(um)\tA-B(V)\n" + table([m.z, m.deflection / 0.08])
    yield Export(
        name, "volts, no sensitivity", text.encode(), m, {}, True, "--sensitivity '50 nm/V'"
    )


# ---- NT-MDT -------------------------------------------------------------------------------------


def ntmdt(name: str, draw: np.random.Generator) -> Iterator[Export]:
    """NT-MDT Nova: three columns without titles, height [nm] and DFL [nA] of both ways."""

    def three(m: Measurement, factor: float, sign: float = 1.0) -> str:
        approach, retract = m.rows("approach"), m.rows("retract")
        columns = [
            sign * 1e3 * m.z[approach],
            factor * m.deflection[approach],
            factor * m.deflection[retract][::-1],
        ]
        return table(columns, decimal=",", style=".4f")

    roles = {"columns": ("z=1", "deflection=2"), "units": {"length": "nm", "deflection": "nA"}}
    m = afm(draw)
    yield Export(name, "as exported", three(m, 1e3 / 25.0).encode(), m, refusal="--columns")
    m = afm(draw)
    how = roles | {"sensitivity": "25 nm/nA"}
    yield Export(name, "roles and sensitivity", three(m, 40.0).encode(), m, how, True)
    m = afm(draw)
    yield Export(name, "falling", three(m, 40.0, -1.0).encode(), m, how, True, said="reversed")
    m = afm(draw)
    how = roles | {"sensitivity": "25 nm/V"}
    yield Export(name, "wrong sensitivity", three(m, 40.0).encode(), m, how, True, "another signal")
    m = afm(draw)
    yield Export(
        name,
        "no unit",
        three(m, 40.0).encode(),
        m,
        {"columns": ("z=1", "deflection=2")},
        True,
        "--units deflection=",
    )
    m = afm(draw)
    titles = "Height, nm\tDFL Forward, nA\tDFL Backward, nA\n"
    yield Export(
        name, "titles", (titles + three(m, 40.0)).encode(), m, {"sensitivity": "25 nm/nA"}, True
    )


# ---- Optics11 -----------------------------------------------------------------------------------


OPTICS11_TITLES = "Time (s)\tLoad (uN)\tIndentation (nm)\tCantilever (nm)\tPiezo (nm)\tAuxiliary"


def optics11(name: str, draw: np.random.Generator) -> Iterator[Export]:
    """Optics11 Piuma, Chiaro and Pavone: header with k, then five or six columns."""

    def bench() -> Measurement:
        return measure(draw, draw.uniform(8.0, 12.0), 50.0, 5.0, 500.0)

    def write(
        m: Measurement,
        decimal: str = ".",
        k: str = "k (N/m)\t0.500\n",
        scale: float = 1.0,
        titles: str = OPTICS11_TITLES,
    ) -> str:
        head = (
            "Date\t12/05/2025\tTime\t11:20:38\tStatus\tOK\n"
            "Piezo position (nm) (Measured)\t-10.3\n\n"
            f"{k}Tip radius (um)\t50.000\nCalibration factor\t2.809\nSMDuration (s) 0.000\n\n"
            "Device:\tChiaro\nModel: Hertz\nP[max] (uN)\t0.049\nE[eff] (Pa)\t156.009\nComment: \n\n"
        )
        if decimal == ",":
            head = head.replace("0.500", "0,500")
        depth = np.maximum(1e3 * (m.delta - m.delta.max() + 5.0), 0.0)
        columns = [m.t, 1e-3 * m.force, depth, 1e3 * m.deflection, 1e3 * m.z, 0.003 + 0.0 * m.t]
        columns[4] = scale * columns[4]
        return head + titles + "\n" + table(columns, decimal=decimal, style=".6f")

    m = bench()
    yield Export(name, "as exported", write(m).encode(), m, said="0.5 N/m")
    m = bench()
    yield Export(name, "decimal comma", write(m, ",").encode(), m)
    m = bench()
    titles = "Time (s)\tLoad (µN)\tIndentation (µm)\tCantilever (nm)\tPiezo (µm)\tAuxiliary"
    text = write(m, titles=titles, scale=1e-3)
    yield Export(name, "micrometres, Latin-1", text.encode("latin-1"), m)
    m = bench()
    yield Export(name, "no k", write(m, k="").encode(), m, has_spring=True)
    m = bench()
    how = {"columns": ("z=Piezo", "deflection=Cantilever", "time=Time")}
    yield Export(name, "roles by name", write(m).encode(), m, how, True, said="(scene)")
    m = bench()
    how = {"columns": ("Piezo", "Cantilever")}
    yield Export(name, "a length as force", write(m).encode(), m, how, True, said="deflection")


# ---- Anton Paar ---------------------------------------------------------------------------------


def anton_paar(name: str, draw: np.random.Generator) -> Iterator[Export]:
    """Anton Paar UNHT, NHT and bioindenter: Time, Pd, Fn, FnRef, SegmentID and a line of units."""

    def bench() -> Measurement:
        return measure(draw, draw.uniform(80.0, 120.0), 500.0, 20.0)

    def write(
        m: Measurement,
        decimal: str = ",",
        titles: str = "Time\tPd\tFn\tFnRef\tSegmentID",
        units: str = "[s]\t[µm]\t[mN]\t[mN]\t[]",
        factors: tuple[float, float] = (1.0, 1e-6),
    ) -> str:
        head = (
            "Indentation\nDate: 12.05.2025\nTime: 11:20:38\nAcquisition rate : 100,0 [Hz]\n"
            "Max depth : 20,00 µm\nFmax\t=\t0,36\tmN\nPoisson's ratio = 0,50\n\nMeasured values\n"
        )
        segments = np.repeat(["0", "2", "4", "5"], POINTS // 2).tolist()
        force = factors[1] * m.force
        columns = [m.t, factors[0] * m.delta, force, 0.5 * force + 1.0, segments]
        return head + titles + "\n" + units + "\n" + table(columns, decimal=decimal, style=".7g")

    m = bench()
    yield Export(name, "as exported", write(m).encode("latin-1"), m, said="turning point")
    m = bench()
    text = write(m, ".", units="[s]\t[nm]\t[µN]\t[µN]\t[]", factors=(1e3, 1e-3))
    yield Export(name, "nm and µN", text.encode(), m)
    m = bench()
    blocks = [write(m), write(bench()), write(bench())]
    yield Export(name, "session of three", "\n".join(blocks).encode("latin-1"), m)
    m = bench()
    titles = "Temps\tProfondeur\tForce normale\tFnRef\tSegmentID"
    yield Export(
        name, "French", write(m, titles=titles).encode("latin-1"), m, refusal="no column of"
    )
    m = bench()
    how = {"columns": ("depth=Profondeur", "force=3", "time=Temps")}
    yield Export(name, "French, roles", write(m, titles=titles).encode("latin-1"), m, how)
    m = bench()
    text = "Time\tPd\tFn\n[s]\t[nm]\t[µN]\n" + table(
        [m.t, 1e3 * m.delta, 1e-3 * m.force], style=",.2f", decimal=","
    )
    yield Export(name, "thousands marks", text.encode("latin-1"), m)


# ---- Hysitron -----------------------------------------------------------------------------------


def hysitron(name: str, draw: np.random.Generator) -> Iterator[Export]:
    """Hysitron and Bruker TI: Depth (nm), Load (µN), Time (s)."""

    def bench() -> Measurement:
        return measure(draw, draw.uniform(800.0, 1200.0), 50.0, 2.0)

    head = "Thursday, May 12, 2025  11:20 AM\nNumber of Points = 600\n\n"

    def write(
        m: Measurement,
        titles: str = "Depth (nm)\tLoad (µN)\tTime (s)",
        factors: tuple[float, float] = (1e3, 1e-3),
        **how,
    ) -> str:
        columns = [factors[0] * m.delta, factors[1] * m.force, m.t]
        return head + titles + "\n" + table(columns, style=".7g", **how)

    m = bench()
    yield Export(name, "as exported", write(m).encode("latin-1"), m)
    m = bench()
    text = write(m, "Depth (um)\tLoad (mN)\tTime (s)", (1.0, 1e-6))
    yield Export(name, "um and mN", text.encode(), m)
    m = bench()
    yield Export(name, "depth falls", write(m, factors=(-1e3, 1e-3)).encode(), m, said="reversed")
    m = bench()
    yield Export(name, "decimal comma", write(m, decimal=",").encode("latin-1"), m)
    m = bench()
    columns = [1e3 * m.delta, 1e-3 * m.force, m.t, m.delta / 100.0, 1e-6 * m.force]
    text = head + "Depth (nm)\tLoad (uN)\tTime (s)\tDepth (V)\tLoad (V)\n" + table(columns)
    yield Export(name, "volts beside", text.encode(), m)
    m = bench()
    parts = ["Depth (nm)\tLoad (uN)\tTime (s)"]
    for part, word in (("approach", "Loading segment"), ("retract", "Unloading segment")):
        rows = [c[m.rows(part)] for c in (1e3 * m.delta, 1e-3 * m.force, m.t)]
        parts += [word, table(rows).rstrip()]
    yield Export(name, "marked segments", (head + "\n".join(parts) + "\n").encode(), m)


# ---- CellScale ----------------------------------------------------------------------------------


def cellscale(name: str, draw: np.random.Generator) -> Iterator[Export]:
    """CellScale MicroTester and UniVert: sets and cycles with their parts, sizes, forces."""

    def bench() -> Measurement:
        return measure(draw, draw.uniform(4.0, 6.0), 250.0, 30.0)

    cycles = ["1-Compress"] * POINTS + ["1-Recover"] * POINTS

    def write(
        m: Measurement,
        titles: str = "SetName,Cycle,Time_S,Size_um,Displacement_um,Force_uN",
        factors: tuple[float, float] = (1.0, 1e-3),
        separator: str = ",",
        decimal: str = ".",
        words: list[str] = cycles,
    ) -> str:
        sets = ["Set 1"] * len(m.t)
        columns = [sets, words, m.t, 500.0 - m.delta, factors[0] * m.delta, factors[1] * m.force]
        return titles + "\n" + table(columns, separator, decimal)

    m = bench()
    yield Export(name, "as exported", write(m).encode(), m, suffix=".csv")
    m = bench()
    titles = "SetName,Cycle,Time_S,Size_mm,Displacement_mm,Force_mN"
    yield Export(name, "mm and mN", write(m, titles, (1e-3, 1e-6)).encode(), m, suffix=".csv")
    m = bench()
    titles = "SetName;Cycle;Time_S;Size_um;Displacement_um;Force_uN"
    yield Export(name, "decimal comma", write(m, titles, separator=";", decimal=",").encode(), m)
    m = bench()
    text = write(m, factors=(-1.0, 1e-3))
    yield Export(name, "falling", text.encode(), m, said="reversed", suffix=".csv")
    m = bench()
    text = write(m, factors=(1.0, -1e-3))
    how = {"columns": ("depth=Displacement_um", "force=-Force_uN", "time=3", "segment=Cycle")}
    yield Export(name, "negative forces", text.encode(), m, how, suffix=".csv")
    m = bench()
    two = Measurement(
        m.modulus,
        m.R,
        0.0,
        np.tile(m.delta, 2),
        np.concatenate([m.force, 0.5 * m.force]),
        np.tile(m.z, 2),
        np.concatenate([m.t, m.t + m.t[-1] + 0.01]),
        m.turn,
    )
    words = cycles + [word.replace("1-", "2-") for word in cycles]
    text = write(two, words=words)
    yield Export(name, "two cycles", text.encode(), m, said="repeated", suffix=".csv")


INSTRUMENTS: dict[str, Callable[[str, np.random.Generator], Iterator[Export]]] = {
    "JPK": jpk,
    "NanoScope": nanoscope,
    "Asylum": asylum,
    "Nanosurf": nanosurf,
    "Park": park,
    "NT-MDT": ntmdt,
    "Optics11": optics11,
    "Anton Paar": anton_paar,
    "Hysitron": hysitron,
    "CellScale": cellscale,
}
