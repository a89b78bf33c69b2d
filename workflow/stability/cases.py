# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cases of the stability matrix, axis by axis and pair by pair.

Every case starts from one of the bases and changes one key, or the two of a pair. Cells of one
panel are compared by verdict; the measures of each base are in :mod:`workflow.stability.run`.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

E, NU, RHO = 210e9, 0.3, 7800.0
HEIGHT, PRESSURE, SPEED, CELL = 0.01, 10e6, 10.0, 0.0025  # of the sliding block
SLIDE_TIME = 80e-6
ROLL_RADIUS = 0.46

QUIET = {"output.fields": False, "output.checkpoint_minutes": 0.0}
SLIDE = {"bodies.block.velocity": [SPEED, 0.0, 0.0]}


@dataclass(frozen=True)
class Case:
    """One cell of the matrix.

    Attributes:
        panel: Title of its axis or pair.
        x, y: Its values along them as they are drawn; ``y`` is empty on a single axis.
        base: Name of the base, a key of :data:`BASES`.
        changes: Keys of the scene that it changes.
        moved: What is done to the mesh: ``scale`` (3), ``block`` (3) [m], ``all`` (3) [m].
        spin: Angular velocity given to the bar at the start [rad/s].
    """

    panel: str
    x: str
    y: str
    base: str
    changes: Mapping[str, Any]
    moved: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    spin: float = 0.0

    @property
    def key(self) -> str:
        """What the case is known by in the file of results."""
        return f"{self.panel} | {self.x} | {self.y}"


def ends(time: float, outputs: int = 4) -> dict[str, float]:
    """Return the keys of a run of so long; the step is rounded to fit in the outputs."""
    return {"time.end": time, "time.output_interval": time / outputs}


BASES: dict[str, tuple[str, dict[str, Any]]] = {
    "slide": ("sliding-block", {**SLIDE, **ends(SLIDE_TIME)}),
    "press": ("hertz-cylinder", {"mesh.size": 4e-4, **ends(6e-6)}),
    "load": ("hertz", {"mesh.size": 1e-3, **ends(1e-5)}),
    "corner": (
        "hertz-cylinder",
        {
            "mesh.radius": 0.013,
            "mesh.x": [0.0, 0.012],
            "mesh.fine_x": [0.0, 0.003],
            "mesh.height": 0.02,
            "mesh.depth": 0.02,
            "mesh.size": 4e-4,
            "loads": [{"surface": "zmax", "traction": [0.0, 0.0, -300e6]}],
            **ends(6e-6),
        },
    ),
    "roll": ("carter", {"mesh.size": 6e-4, "time.safety": 0.6, **ends(2e-5)}),
    "drift": (
        "kalker-creepage",
        {
            "mesh.size": 1e-3,
            "mesh.base_size": 1.1e-3,
            "mesh.height": 0.01,
            "mesh.depth": 0.01,
            "mesh.x": [-0.01, 0.012],
            "mesh.fine_x": [-0.003, 0.004],
            "mesh.y": [-0.01, 0.01],
            "mesh.fine_y": [-0.002, 0.002],
            "supports": [],
            "contacts.touch.friction": 0.3,
            "driven.wheel.shift": [0.0, 0.0, 0.0],
            "driven.wheel.shift_time": 0.0,
            "driven.wheel.spin": [0.0, 40 / 0.46, 0.0],
            "time.safety": 0.8,
            **ends(6e-5),
        },
    ),
    "spin": (
        "bar-wave",
        {
            "mesh.width": 0.01,
            "mesh.size": 0.0025,
            "bodies.bar.velocity": [0.0, 0.0, 0.0],
            "bodies.bar.kinematics": "total-lagrangian",
            "supports": [],
            **ends(77.09e-6),
        },
    ),
}


def cases(quick: bool = False) -> list[Case]:
    """Return all cases, or one in four of the pairs and every other of the axes."""
    found = [*_contact_axes(), *_body_axes(), *_geometry_axes(), *_pairs()]
    if not quick:
        return found
    panels = {c.panel: [d for d in found if d.panel == c.panel] for c in found}
    return [c for group in panels.values() for c in group[:: 4 if group[0].y else 2]]


def _axis(
    panel: str, base: str, values: Mapping[str, Any] | tuple[Any, ...], of: Callable[[Any], Any]
) -> Iterator[Case]:
    """Yield the cases of an axis whose changes are ``of(value)``."""
    pairs = values.items() if isinstance(values, Mapping) else ((f"{v:g}", v) for v in values)
    for label, value in pairs:
        yield Case(panel, label, "", base, of(value))


def _penalty_axes() -> Iterator[Case]:
    face = "contacts.face."
    factors = (0.001, 0.01, 0.1, 0.4, 1, 2, 3, 3.9, 4.1, 6, 10)
    yield from _axis("penalty factor", "slide", factors, lambda p: {face + "penalty": p})
    yield from _axis(
        "modulus-penalty factor",
        "slide",
        (0.1, 0.3, 1, 3, 10, 30, 100),
        lambda p: {face + "method": "modulus-penalty", face + "penalty": p},
    )
    yield from _axis(
        "implicit-penalty factor",
        "slide",
        (0.1, 0.4, 1, 4, 10, 30, 100, 1000),
        lambda p: implicit(p, "face"),
    )


def _contact_axes() -> Iterator[Case]:
    face = "contacts.face."
    yield from _penalty_axes()
    yield from _axis(
        "step factor",
        "slide",
        (0.1, 0.3, 0.6, 0.9, 1, 1.02, 1.05, 1.1),
        lambda s: {"time.safety": s},
    )
    yield from _axis(
        "contact damping / critical",
        "slide",
        (0, 0.1, 0.3, 0.5, 1, 1.4, 2),
        lambda z: {face + "damping": float(z)},
    )
    yield from _axis(
        "friction", "slide", (0, 0.1, 0.3, 0.6, 1, 1.5), lambda f: {face + "friction": float(f)}
    )
    yield from _axis("sliding speed [m/s]", "slide", (0, 1, 10, 50, 100, 300), sliding)
    yield from _axis(
        "method",
        "slide",
        {
            "one pass": {},
            "two-pass": {face + "two_pass": True},
            "smooth": {face + "smooth": True},
            "implicit 10": implicit(10, "face"),
            "Lagrange": {face + "method": "lagrange"},
        },
        lambda keys: keys,
    )


def implicit(penalty: float, contact: str) -> dict[str, Any]:
    """Return the keys of springs at the end of the step, of so many m/dt²."""
    prefix = f"contacts.{contact}."
    return {prefix + "method": "implicit-penalty", prefix + "penalty": float(penalty)}


def sliding(speed: float) -> dict[str, Any]:
    """Return the keys of a speed, with a base that is long enough."""
    room = 0.04 if speed < 100 else 0.06
    return {"bodies.block.velocity": [float(speed), 0.0, 0.0], "mesh.base": [room, 0.03, 0.01]}


def softer(ratio: float) -> dict[str, Any]:
    """Return the keys of a base that is so many times softer; pressed the less, and slower.

    Speed goes with the root, so that it stays below the waves of the soft base.
    """
    load = {"surface": "zmax", "traction": [0.0, 0.0, -PRESSURE / ratio]}
    return {
        "bodies.base.material": material(E / ratio),
        "loads": [load],
        "bodies.block.velocity": [SPEED / ratio**0.5, 0.0, 0.0],
    }


def material(modulus: float = E, nu: float = NU) -> dict[str, float]:
    """Return the table of an isotropic material."""
    return {"youngs_modulus": modulus, "poisson_ratio": nu, "density": RHO}


def _body_axes() -> Iterator[Case]:
    yield from _axis("stiffness ratio", "slide", (1, 10, 100, 1e3, 1e4, 1e5, 1e6), softer)
    one = {"1": 1, "10": 10, "100": 100, "1 k": 1e3, "10 k": 1e4, "50 k": 5e4, "500 k": 5e5}
    yield from _axis("load on a sphere [N]", "load", one, pressed)
    pressed_by: dict[str, tuple[str, dict[str, Any]]] = {
        "line": ("press", {}),
        "sphere, 10 kN": ("load", pressed(1e4)),
        "roller": ("roll", {}),
        "wheel, 20 mrad": ("drift", drifting(20)),
    }
    for label, (base, keys) in pressed_by.items():
        yield Case("implicit 30, contact of", label, "", base, {**keys, **implicit(30, "touch")})
    yield from _axis("angle of attack [mrad]", "drift", (0, 5, 10, 20, 40, 60), drifting)
    yield from _axis("rotation, rolling [rad/s]", "roll", (10, 50, 174, 500, 1000), rolling)


def pressed(load: float) -> dict[str, Any]:
    """Return the keys of a load [N] on the whole sphere of scene ``hertz``, a quarter of it."""
    area, fit = 0.02**2, {"surface": "zmax", "traction": [0.0, 0.0, 0.0]}
    return {"loads": [fit | {"traction": [0.0, 0.0, -load / 4 / area]}]}


def drifting(mrad: float) -> dict[str, Any]:
    """Return the keys of a rail that passes under an angle."""
    return {"driven.rail.velocity": [-40.0, 40.0 * mrad * 1e-3, 0.0]}


def rolling(spin: float) -> dict[str, Any]:
    """Return the keys of a roller of so many rad/s, with Carter's creepage."""
    speed = spin * ROLL_RADIUS / (1 + 7.6e-4)
    time = min(2e-5, 0.006 / speed)
    return {
        "driven.roller.spin": [0.0, float(spin), 0.0],
        "driven.block.velocity": [-speed, 0.0, 0.0],
        **ends(time),
    }


def flat(ratio: float) -> tuple[dict[str, Any], dict[str, tuple[float, float, float]]]:
    """Return the keys of the faster run of flat cells, and how the mesh is scaled for them."""
    return ends(SLIDE_TIME / ratio), {"scale": (1, 1, 1 / ratio)} if ratio != 1 else {}


def _geometry_axes() -> Iterator[Case]:
    for a in (1, 2, 5, 10, 20, 50):
        yield Case("cell aspect", f"{a:g}", "", "slide", *flat(a))
    for share in (0, 0.001, 0.009, 0.02, 0.1, 0.5, 1):
        moved = {"block": (0.0, 0.0, -share * CELL)}
        yield Case("initial penetration / cell", f"{share:g}", "", "slide", {}, moved)
    match, half = {"mesh.base_size": CELL}, CELL / 2
    for label, shift in (("vertex", (0, 0, 0)), ("edge", (0, half, 0)), ("facet", (half, half, 0))):
        yield Case("nodes start on", label, "", "slide", match, {"block": shift})
    for label, room in (("2 mm", 0.024), ("1 mm", 0.022), ("0", 0.02)):
        short = {"bodies.block.velocity": [100.0, 0.0, 0.0], "mesh.base": [room, room, 0.01]}
        yield Case("target ends, at 100 m/s, after", label, "", "slide", short)
    for smooth in (False, True):
        for size in (5e-4, 2.5e-4):
            swapped = {
                "contacts.touch.contactor": "base_top",
                "contacts.touch.target": "cap",
                "contacts.touch.smooth": smooth,
                "mesh.size": size,
            }
            label = f"{'smooth' if smooth else 'facets'} {size * 1e3:g}"
            yield Case("target of R = 13 mm, cells [mm]", label, "", "corner", swapped)
    for label, far in (("0", 0.0), ("10 m", 10.0), ("1 km", 1e3), ("100 km", 1e5)):
        single = {"time.precision": "float32"}
        yield Case("float32, shifted by", label, "", "slide", single, {"all": (far, far, far)})


def _methods() -> Iterator[Case]:
    face = "contacts.face."
    methods: dict[str, dict[str, Any]] = {
        "penalty 0.4": {},
        "penalty 2": {face + "penalty": 2.0},
        **{f"implicit {p}": implicit(p, "face") for p in (1, 10, 100)},
        "Lagrange": {face + "method": "lagrange"},
    }
    for method, own in methods.items():
        for f in (0.0, 0.1, 0.3, 0.6, 1.0):
            yield Case(
                "method × friction", f"{f:g}", method, "slide", {**own, face + "friction": f}
            )


def _pairs() -> Iterator[Case]:
    face = "contacts.face."
    for p in (0.01, 0.4, 1.0, 2.0, 3.9, 6.0):
        for s in (0.1, 0.5, 0.9, 1.0, 1.1):
            keys = {face + "penalty": p, "time.safety": s}
            yield Case("penalty × step factor", f"{s:g}", f"{p:g}", "slide", keys)
        for r in (1, 100, 1e4, 1e6):
            yield Case(
                "penalty × stiffness ratio",
                f"{r:g}",
                f"{p:g}",
                "slide",
                {face + "penalty": p, **softer(r)},
            )
        for a in (1, 5, 20, 50):
            keys, moved = flat(a)
            keys = {face + "penalty": p, **keys}
            yield Case("penalty × cell aspect", f"{a:g}", f"{p:g}", "slide", keys, moved)
    for f in (0.0, 0.1, 0.3, 0.6, 1.0, 1.5):
        for v in (0, 1, 10, 100, 300):
            keys = {face + "friction": f, **sliding(v)}
            yield Case("friction × sliding speed [m/s]", f"{v:g}", f"{f:g}", "slide", keys)
    yield from _methods()
    for z in (0.0, 0.3, 0.5, 1.0, 2.0):
        for s in (0.1, 0.5, 0.9, 1.0, 1.1):
            keys = {face + "damping": z, "time.safety": s}
            yield Case("contact damping × step factor", f"{s:g}", f"{z:g}", "slide", keys)
    for element in ("full", "one-point", "selective"):
        for nu in (0.0, 0.3, 0.45, 0.49, 0.499, 0.4999):
            law: dict[str, Any] = {"element": element, "material": material(nu=nu)}
            keys = {f"bodies.{b}.{k}": v for b in ("cylinder", "flat") for k, v in law.items()}
            yield Case("element × Poisson ratio", f"{nu:g}", element, "press", keys)
    for precision in ("float64", "float32"):
        for spin in (10.0, 100.0, 300.0, 1000.0):
            yield Case(
                "precision × rotation, free [rad/s]",
                f"{spin:g}",
                precision,
                "spin",
                {"time.precision": precision},
                spin=spin,
            )
