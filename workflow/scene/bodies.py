# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of a body: material, element, kinematics, damping."""

from collections.abc import Iterator
from functools import partial
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    model_serializer,
    model_validator,
)
from pydantic_core import PydanticCustomError

from workflow.scene.steels import Grade, constants
from workflow.scene.units import (
    Component,
    Delay,
    Density,
    Factor,
    Hardening,
    Length,
    Modulus,
    Position,
    Rate,
    Ratio,
    Section,
    Share,
    Speed,
)

LINEAR = ("hooke", "orthotropic")
MEMORY = ("j2",)  # laws with a memory
FOLLOWING = (*LINEAR, *MEMORY)  # laws that follow the kinematics of their body

Element = Literal["full", "one-point", "selective"]
Axis = tuple[Component, Component, Component]
Place = tuple[Position, Position, Position]


def _known(law: str) -> str:
    """Return the name of a law if ``forms.elements.LAWS`` has it or it is ``hooke``.

    The registry is loaded, and UFL with it, only for names beside those that are listed here.
    """
    if law not in ("hooke", "neo-hookean"):
        from forms.elements import LAWS

        if law not in LAWS:
            names = ", ".join(repr(name) for name in ("hooke", *LAWS, "orthotropic", *MEMORY))
            raise PydanticCustomError("material_law", "one of {names}", {"names": names})
    return law


def fit(law: str, kinematics: str) -> tuple[str, bool]:
    """Return the kinematics that a material law expects, and if it has the element ``selective``.

    Args:
        law: Name of the law.
        kinematics: That of the body, which Hooke's law follows.
    """
    if law in MEMORY:
        return kinematics, True
    if law in LINEAR:
        return kinematics, law == "hooke" and kinematics == "small-strain"
    if law == "neo-hookean":
        return "total-lagrangian", True
    from forms.elements import LAWS

    own = LAWS[law]
    return "total-lagrangian" if own.rotating else "small-strain", own.shape is not None


class Isotropic(Section):
    """Isotropic elastic material with a law of ``forms.elements.LAWS`` by name.

    ``hooke`` is the law of the body's kinematics, St. Venant-Kirchhoff's in total Lagrangian form.
    """

    law: Annotated[str, AfterValidator(_known)] = "hooke"
    """Name of the law: `hooke`, `neo-hookean`, or one that a script has put into `LAWS`."""
    youngs_modulus: Modulus
    """Young's modulus."""
    poisson_ratio: Ratio
    """Poisson's ratio."""
    density: Density
    """Mass density."""

    def constants(self, damping: float = 0.0) -> Any:
        """Return the elastic constants as the forms take them."""
        from forms.elasticity import Elastic

        return Elastic(self.youngs_modulus, self.poisson_ratio, self.density, damping)


class BackStress(Section):
    """A back stress after Armstrong and Frederick, ``2/3 modulus ε̇_p − recall X ṗ``.

    It grows to ``modulus / recall``; without recall its hardening is linear.
    """

    modulus: Modulus = Field(examples=[60e9])
    """Its first slope, of stress over plastic strain."""
    recall: Share = Field(0.0, examples=[300.0])
    """How fast it forgets: its largest value is `modulus / recall`; 0 for linear hardening."""


def _of_a_grade_or_complete(schema: dict[str, Any]) -> None:
    """Require a grade, or all that it stands for."""
    schema["anyOf"] = [{"required": ["steel"]}, {"required": schema.pop("required")}]


class ElastoPlastic(Section):
    """Isotropic steel that yields: J2 plasticity with isotropic and kinematic hardening.

    The flow stress is ``yield_stress + hardening_modulus p + saturation_stress (1 − exp(−
    saturation_rate p))`` of the equivalent plastic strain p. Small or large strain, as the body's
    kinematics say.
    """

    model_config = ConfigDict(json_schema_extra=_of_a_grade_or_complete)

    law: Literal["j2"]
    """Names this kind of material."""
    steel: Grade | None = Field(default=None, examples=["R260"])
    """Grade that yields at 480 (`R260`), 770 (`R350HT`), 520 (`ER7`), 540 MPa (`ER8`), perfectly
    plastic: `law` and constants are its own where they are left out. The page *Steels* says how
    well they are known.
    """
    youngs_modulus: Modulus
    """Young's modulus."""
    poisson_ratio: Ratio
    """Poisson's ratio."""
    density: Density
    """Mass density."""
    yield_stress: Modulus
    """Stress at which it first yields."""
    hardening_modulus: Hardening = 0.0
    """Linear isotropic hardening: slope of the flow stress over the plastic strain."""
    saturation_stress: Hardening = Field(0.0, examples=[150e6])
    """What Voce's hardening adds to the flow stress in the end; with `saturation_rate`."""
    saturation_rate: Share = Field(0.0, examples=[40.0])
    """How fast Voce's hardening comes: it is there to 63 % at a plastic strain of one over it."""
    back_stresses: tuple[BackStress, ...] = Field(
        (), examples=[[{"modulus": 60e9, "recall": 300.0}]]
    )
    """Kinematic hardening: back stresses after Armstrong and Frederick, as many as wanted."""

    @model_validator(mode="before")
    @classmethod
    def _is_a_grade(cls, data: Any) -> Any:
        """Fill in what a grade stands for where it is left out."""
        if not isinstance(data, dict) or "steel" not in data:
            return data
        return constants(data["steel"]) | data

    @model_serializer(mode="wrap")
    def _as_given(self, write: Any) -> dict[str, Any]:
        """Leave out what a grade stands for: another one then has constants of its own."""
        table: dict[str, Any] = write(self)
        own = {} if self.steel is None else constants(self.steel)
        return {k: v for k, v in table.items() if k not in own or own[k] != v}

    def constants(self, damping: float = 0.0) -> Any:
        """Return the constants as the forms take them.

        Raises:
            ValueError: if they are those of no steel (:class:`forms.plasticity.ElastoPlastic`).
        """
        from forms import plasticity

        return plasticity.ElastoPlastic(
            self.youngs_modulus,
            self.poisson_ratio,
            self.density,
            damping,
            self.yield_stress,
            self.hardening_modulus,
            self.saturation_stress,
            self.saturation_rate,
            tuple(plasticity.BackStress(b.modulus, b.recall) for b in self.back_stresses),
        )


class Orthotropic(Section):
    """Linear material with three planes of symmetry."""

    law: Literal["orthotropic"]
    """Names this kind of material."""
    youngs_moduli: tuple[Modulus, Modulus, Modulus] = Field(examples=[[12e9, 0.8e9, 0.6e9]])
    """Young's moduli along the three axes of the material."""
    poisson_ratios: tuple[Component, Component, Component] = Field(examples=[[0.4, 0.4, 0.3]])
    """Poisson's ratios of the pairs 12, 13, 23."""
    shear_moduli: tuple[Modulus, Modulus, Modulus] = Field(examples=[[0.8e9, 0.7e9, 0.1e9]])
    """Shear moduli of the pairs 12, 13, 23."""
    axes: tuple[Axis, Axis, Axis] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    """The axes of the material, three orthonormal vectors."""
    density: Density = Field(examples=[450.0])
    """Mass density."""

    def constants(self, damping: float = 0.0) -> Any:
        """Return the elastic constants as the forms take them.

        Raises:
            ValueError: if the axes are not orthonormal or an energy is not positive.
        """
        from forms import materials

        moduli, ratios, shear = self.youngs_moduli, self.poisson_ratios, self.shear_moduli
        return materials.Orthotropic(moduli, ratios, shear, self.density, damping, self.axes)


def law_of(material: Any) -> str:
    """Return which table of a material is meant: ``isotropic``, ``orthotropic`` or ``j2``."""
    get = material.get if isinstance(material, dict) else partial(getattr, material)
    law = get("law", "j2" if isinstance(material, dict) and "steel" in material else "hooke")
    return str(law) if law in ("orthotropic", *MEMORY) else "isotropic"


Material = Annotated[
    Annotated[Isotropic, Tag("isotropic")]
    | Annotated[Orthotropic, Tag("orthotropic")]
    | Annotated[ElastoPlastic, Tag("j2")],
    Discriminator(law_of),
]


class BulkViscosity(Section):
    """Pressure against fast compression, which spreads shocks over a few cells."""

    linear: Share = 0.06
    """Coefficient of the pressure in proportion to the rate of volume."""
    quadratic: Share = 1.5
    """Coefficient of the pressure in proportion to its square."""


class Zone(Section):
    """A part of a body: cells whose centres are where all that is given says."""

    depth: Length | None = Field(default=None, examples=[0.012])
    """Distance from the surfaces of the body that contacts name."""
    box: tuple[Place, Place] | None = Field(
        default=None, examples=[[[-0.05, 0.68, -0.02], [0.25, 0.8, 0.0]]]
    )
    """Least and largest coordinates in the undeformed mesh."""

    def unfit(self, key: str) -> Iterator[str]:
        """Yield a line for what cannot be; ``key`` is that of the table."""
        if self.depth is None and self.box is None:
            yield f"{key}: expected depth, box or both, got neither"
        if self.box and not all(a < b for a, b in zip(*self.box, strict=True)):
            box = [*map(list, self.box)]
            yield f"{key}.box = {box}: expected the least coordinates, then larger ones"


class Yielding(Zone):
    """The part of a body that may yield."""


class ContactZone(Zone):
    """The part of a body that has another element than the rest."""

    element: Element = Field("full", examples=["full"])
    """Integration of its hexahedra, as `element` of the body."""


class Body(Section):
    """Regions of the mesh that share a material, an element and kinematics."""

    regions: list[str] = Field(min_length=1)
    """Regions of the mesh that this body is made of."""
    material: Material
    """Law and constants of the material."""
    yielding: Yielding | None = None
    """Part of a body of `law = "j2"` that may yield, elsewhere it is elastic; all if left out."""
    kinematics: Literal["small-strain", "total-lagrangian"] = "small-strain"
    """Strain measure; left out, `total-lagrangian` for a body that the scene makes turn."""
    element: Element = "full"
    """Integration of the hexahedra: `full` has 2 × 2 × 2 points, `one-point` one and hourglass
    control, `selective` the mean change of volume, which does not lock near ν = 1/2.
    """
    contact_zone: ContactZone | None = Field(
        default=None, examples=[{"depth": 0.008, "element": "full"}]
    )
    """Part of the body with another element, such as `full` under the patches of `one-point`;
    cells that may yield are of it.
    """
    hourglass_coefficient: Factor | None = Field(default=None, examples=[0.1])
    """Hourglass stiffness of `one-point` cells; left out, it comes from the material."""
    stiffness_damping: Delay = 0.0
    """Rayleigh damping in proportion to the stiffness: damping ratio π f times this."""
    mass_damping: Rate = 0.0
    """Rayleigh damping in proportion to the mass."""
    bulk_viscosity: BulkViscosity | None = None
    """Pressure against fast compression; left out, there is none."""
    velocity: tuple[Speed, Speed, Speed] | None = None
    """Velocity of the whole body at time zero."""

    @property
    def near_element(self) -> Element:
        """Element of the contact zone, and of cells that may yield; that of all if it has none."""
        return self.element if self.contact_zone is None else self.contact_zone.element

    @property
    def elements(self) -> tuple[Element, ...]:
        """All elements of its cells, that of the bulk first."""
        return tuple(dict.fromkeys((self.element, self.near_element)))
