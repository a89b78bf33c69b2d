# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grades of steel by name."""

import pytest

from workflow import Scene, SceneError
from workflow.scene.reference import find
from workflow.scene.steels import STEELS


def bar(**material):
    """Return the material of a bar."""
    return Scene.load("plastic-bar", **{"bodies.bar.material": material}).bodies["bar"].material


def test_a_grade_stands_for_its_constants():
    """ER7 is J2 steel of 520 MPa without hardening; what stands beside its name is put over it."""
    steel = bar(steel="ER7")
    assert (steel.law, steel.yield_stress, steel.density) == ("j2", 520e6, 7800.0)
    assert (steel.youngs_modulus, steel.poisson_ratio) == (210e9, 0.3)
    assert steel.hardening_modulus == steel.saturation_stress == len(steel.back_stresses) == 0
    own = bar(steel="ER7", youngs_modulus=206e9, back_stresses=[{"modulus": 60e9}])
    assert (own.yield_stress, own.youngs_modulus) == (520e6, 206e9)
    assert own.back_stresses[0].modulus == 60e9


def test_another_grade_has_its_own_constants():
    """A scene of R260 that is changed to R350HT yields at 770 MPa, and keeps what was put over."""
    scene = Scene.load("plastic-bar", **{"bodies.bar.material": {"steel": "R260"}})
    scene = scene.with_(**{"bodies.bar.material.hardening_modulus": 5e9})
    assert scene.bodies["bar"].material.yield_stress == 480e6
    other = scene.with_(**{"bodies.bar.material.steel": "R350HT"}).bodies["bar"].material
    assert (other.yield_stress, other.hardening_modulus) == (770e6, 5e9)


@pytest.mark.parametrize(
    ("material", "words"),
    [
        ({"steel": "R261"}, "bodies.bar.material.steel = 'R261': expected 'R260', 'R350HT'"),
        ({"steel": ["R260"]}, "bodies.bar.material.steel = ['R260']: expected 'R260'"),
        ({"steel": "R260", "law": "hooke"}, "bodies.bar.material.steel = 'R260': unknown key"),
        ({"law": "j2"}, "bodies.bar.material.yield_stress: missing"),
    ],
)
def test_what_is_no_grade_is_refused(material, words):
    """Unknown grade, a list, a grade that does not yield, no grade and no constants."""
    with pytest.raises(SceneError) as caught:
        bar(**material)
    assert words in str(caught.value)
    assert ("\n" in str(caught.value)) == ("law" in material)  # one line for one mistake


def test_the_reference_says_what_grades_yield_at():
    """The text of the key has the yield stresses of the table, in MPa, each with its grade."""
    (key,) = find("bodies.NAME.material.steel")
    for name, steel in STEELS.items():
        assert f"{steel.yield_stress / 1e6:.0f}" in key.text and f"`{name}`" in key.text
    assert [k.default for k in find("bodies.NAME.material.yield_stress")] == [None]


def test_yield_stresses_are_below_tensile_strengths():
    """0.5 to 0.7 of the least tensile strength, as in pearlitic steel; every value has a source."""
    for steel in STEELS.values():
        assert 0.5 < steel.yield_stress / steel.tensile_strength[0] < 0.7
        assert "EN 13" in steel.source and steel.confidence
