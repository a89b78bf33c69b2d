# SPDX-License-Identifier: LGPL-3.0-or-later
"""Models of gmsh: parameters of scripts and functions arrive, named hexahedra come back."""

import numpy as np
import pytest

from meshes.formats import gmsh_model
from meshes.quality import quality

gmsh = pytest.importorskip("gmsh", exc_type=ImportError)

BOX = """DefineConstant[ length = 2 ];
DefineConstant[ n = 4 ];
Point(1) = {0, 0, 0};
c[] = Extrude {length, 0, 0} { Point{1}; Layers{n}; };
s[] = Extrude {0, 1, 0} { Curve{c[1]}; Layers{2}; Recombine; };
v[] = Extrude {0, 0, 1} { Surface{s[1]}; Layers{3}; Recombine; };
Physical Volume("Box") = {v[1]};
Physical Surface("low") = {s[1]};
"""
NAMES = ("box", "low")


def box(length: float, n: int) -> None:
    """The same box by gmsh's module."""
    part = [(0, gmsh.model.geo.addPoint(0, 0, 0))]
    low = 0
    for shift, cells in (((length, 0, 0), n), ((0, 1, 0), 2), ((0, 0, 1), 3)):
        low = part[0][1]
        made = gmsh.model.geo.extrude(part, *shift, [cells], [], True)
        part = made[1:2]
    gmsh.model.geo.synchronize()
    gmsh.model.addPhysicalGroup(3, [part[0][1]], name="box")
    gmsh.model.addPhysicalGroup(2, [low], name="low")


def refused(model, parameters=None, names=NAMES) -> str:
    with pytest.raises(ValueError) as caught:
        gmsh_model.meshed(model, parameters or {}, names=names)
    assert not gmsh.isInitialized()
    return str(caught.value)


@pytest.fixture
def script(tmp_path):
    """Writes a script and returns its path."""

    def write(text: str):
        (tmp_path / "model.geo").write_text(text)
        return tmp_path / "model.geo"

    return write


@pytest.mark.parametrize("given", [{}, {"length": 3.0, "n": 5}, {"length": 0.5}])
@pytest.mark.parametrize("kind", ["script", "function"])
def test_parameters_arrive(script, given, kind):
    """length × 1 × 1 m of n × 2 × 3 cells, from a script with defaults and from a function."""
    values = {"length": 2.0, "n": 4} | given
    model, parameters = (script(BOX), given) if kind == "script" else (box, values)
    mesh = gmsh_model.meshed(model, parameters, names=NAMES)
    assert len(mesh.cells) == 6 * values["n"] and len(mesh.facets) == 2 * values["n"]
    assert quality(mesh).volume == pytest.approx(values["length"]) == quality(mesh).enclosed
    assert np.ptp(mesh.points, axis=0) == pytest.approx([values["length"], 1, 1])
    assert mesh.counts(mesh.regions) == {"box": 6 * values["n"]}
    assert not mesh.points[mesh.surface(mesh.tag("low"))][:, :, 2].any()
    assert not gmsh.isInitialized()


def test_parameters_that_would_be_lost_are_refused(script):
    """A variable that the script sets itself, one it has not, in its includes neither; keywords."""
    fixed = script(BOX.replace("DefineConstant[ length = 2 ];", "length = 2;"))
    assert "sets it to [2.0] itself; expected DefineConstant" in refused(fixed, {"length": 3.0})
    assert "mesh.parameters.lenght: the script has no such" in refused(script(BOX), {"lenght": 3.0})
    (fixed.parent / "numbers.geo").write_text("DefineConstant[ length = 2 ];\n")
    split = 'Include "numbers.geo";\n' + BOX.split("\n", 1)[1]
    mesh = gmsh_model.meshed(script(split), {"length": 3.0}, names=NAMES)
    assert quality(mesh).volume == pytest.approx(3)
    assert "mesh.parameters = ['lenght']" in refused(box, {"lenght": 3.0})


def test_other_cells_than_hexahedra_are_refused(script):
    """Tetrahedra with their number and how to recombine; prisms; second order; triangles beside."""
    loose = 'SetFactory("OpenCASCADE");\nBox(1) = {0, 0, 0, 1, 1, 1};\n'
    message = refused(script(loose + 'Physical Volume("Box") = {1};\n'))
    assert "of Tetrahedron 4; expected Hexahedron 8 only" in message and "Recombine" in message
    prisms = BOX.replace("{ Curve{c[1]}; Layers{2}; Recombine; }", "{ Curve{c[1]}; Layers{2}; }")
    assert "Prism 6" in refused(script(prisms))
    second = refused(script(BOX + "Mesh.ElementOrder = 2;\n"))
    assert "Hexahedron 27" in second or "Hexahedron 20" in second
    assert "no physical volume" in refused(script(BOX.replace("Physical Volume", "//")))
    beside = "Point(99) = {9, 9, 9}; l[] = Extrude {1, 0, 0} { Point{99}; Layers{1}; };\n"
    beside += "t[] = Extrude {0, 1, 0} { Curve{l[1]}; Layers{1}; };\n"
    beside += 'Physical Surface("flap") = {t[1]};\n'
    assert "surface 'flap' has 2 triangle" in refused(script(BOX + beside), {}, (*NAMES, "flap"))


def test_groups_that_are_not_there_are_named(script):
    """The names of the model are listed; a region that is left out too."""
    assert "no groups ['lid']; the file has regions ['Box']" in refused(script(BOX), {}, ("lid",))
    assert "24 hexahedra are in none of the groups used" in refused(script(BOX), {}, ("low",))


def test_a_model_that_fails_says_where(script):
    """A line that gmsh does not take, a function that raises, ends gmsh, or finds it in use."""
    assert "model.geo', line 9: Unknown variable 'x'" in refused(script(BOX + "y = x;\n"))

    def broken() -> None:
        raise ZeroDivisionError("of nothing")

    assert "broken: ZeroDivisionError: of nothing" in refused(broken)
    assert "ended gmsh" in refused(gmsh.finalize)
    gmsh.initialize(interruptible=False)
    try:
        with pytest.raises(ValueError, match="in use in this process"):
            gmsh_model.meshed(box, {"length": 1.0, "n": 1}, names=NAMES)
        assert gmsh.isInitialized()
    finally:
        gmsh.finalize()
