"""PeakForce captures, with a stand-in for the arrays of pyfmreader."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from nanoscope_files import PEAKFORCE_CAPTURE

from indent_sim.results.measured.curve_file import read_curves
from indent_sim.results.measured.measurement import NoCurve, Uncalibrated

HEADER = {"Entry_tot_nb_curve": 1, "spring_const_Nbym": 0.1, "defl_sens_nmbyV": 30.0}
N = 50


def segment(way, volts):  # type: ignore[no-untyped-def]
    """Part of a curve as pyfmreader stores it, from the far end on, in m, V and s."""
    return SimpleNamespace(
        segment_formated_data={"height": way, "vDeflection": volts, "time": np.linspace(0, 0.98, N)}
    )


@pytest.fixture
def reader(monkeypatch, tmp_path):  # type: ignore[no-untyped-def]
    """Read a file with a given header and given curves."""

    def read(header, swing=1.0, stiffness=None):  # type: ignore[no-untyped-def]
        way = np.linspace(0, 2e-6, N)
        volts = swing * np.maximum(way - 1e-6, 0) / 1e-6
        parts = [("0", segment(way, volts)), ("1", segment(way, 0.9 * volts))]
        loading, parsing = ModuleType("loadnanosccurve"), ModuleType("parsenanoscheader")
        loading.loadNANOSCcurve = lambda k, header: SimpleNamespace(get_segments=lambda: parts)  # type: ignore[attr-defined]
        parsing.parseNANOSCheader = lambda path: header  # type: ignore[attr-defined]
        modules = {"loadnanosccurve": loading, "parsenanoscheader": parsing}
        for name in ("pyfmreader", "pyfmreader.nanosc"):
            monkeypatch.setitem(sys.modules, name, ModuleType(name))
        for name, module in modules.items():
            monkeypatch.setitem(sys.modules, f"pyfmreader.nanosc.{name}", module)
        (tmp_path / "gel.PFC").write_bytes(PEAKFORCE_CAPTURE)
        return read_curves(tmp_path / "gel.PFC", stiffness=stiffness)

    return read


def test_forces_and_ways_in_the_order_of_time(reader):
    (curve,) = reader(HEADER)
    assert (
        curve.name == "gel"
        and curve.stiffness == 0.1
        and dict(curve.parts)["retract"] == slice(N, 2 * N)
    )
    assert curve.force[N - 1] == pytest.approx(0.1 * 30e-9) and curve.force[N] == pytest.approx(
        0.9 * 0.1 * 30e-9
    )
    assert curve.z[0] == curve.z[-1] == 0 and curve.z[N - 1] == curve.z[N] == 2e-6
    assert np.all(np.diff(curve.t) > 0)


def test_a_volume_has_all_its_curves(reader):
    assert [one.name for one in reader(HEADER | {"Entry_tot_nb_curve": 3})] == [
        "gel-0",
        "gel-1",
        "gel-2",
    ]


def test_what_is_missing_is_said_and_may_be_given(reader):
    without = {key: value for key, value in HEADER.items() if key != "spring_const_Nbym"}
    with pytest.raises(Uncalibrated, match=r"lacks spring constant: --set experiment\.cantilever"):
        reader(without)
    assert reader(without, stiffness=0.5)[0].stiffness == 0.5
    with pytest.raises(Uncalibrated, match="lacks sensitivity"):
        reader({key: value for key, value in HEADER.items() if key != "defl_sens_nmbyV"})


def test_deflections_that_cannot_be_and_broken_headers_are_no_curve(reader):
    with pytest.raises(NoCurve, match="exceed the travel of the base"):
        reader(HEADER, swing=200.0)  # 6 um on a way of 2
    with pytest.raises(NoCurve, match=r"pyfmreader cannot read it \(KeyError"):
        reader({})
