# SPDX-License-Identifier: LGPL-3.0-or-later
"""Labels of wheel modes: nodal diameters, nodal circles, share of each direction.

A mode of a body of revolution moves as ``cos nθ`` axially and radially and as ``sin nθ``
circumferentially, or a quarter of a wave further on. The nodes are taken ring by ring (patch by
patch of the section where there are no rings) and their motion is projected on these waves by least
squares with the nodal masses, so uneven angles do no harm. The order n with most kinetic energy is
that of the mode.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array

ORDERS = 24  # highest number of nodal diameters that is looked for
PATCH = 0.015  # edge of a patch of the section where nodes do not lie in rings [m]
RIGID = 1.0  # Hz: slower is no vibration
PAIRED = 0.05  # widest split of a pair
ALIKE = 0.8  # least correlation of the sections of a pair
EVEN = 1e-6  # a pair closer than this is one of a body of revolution: any phase will do
STILL = 0.05  # of the largest axial motion: less has no sign
NO_AXIAL = 1e-3  # share of the energy: less has no nodal circles
BINS = 30  # of the radius, for nodal circles
NAMES = ("axial", "radial", "circumferential")


@dataclass(frozen=True)
class Mode:
    """One natural frequency and what moves.

    Attributes:
        number: From 1, ascending.
        frequency: In Hz.
        kind: Direction of most motion of the rim, or of the whole if there is no axle; ``rigid``.
        shares: Kinetic energy of each direction: axial, radial, circumferential, or x, y, z.
        diameters: Nodal diameters n, None without axle.
        circles: Nodal circles m of the axial motion between hub and rim, None if there is none.
        purity: Share of the kinetic energy in order n.
        partner: Number of the other mode of its pair, None if it is single.
        split: Distance of the two over their mean, None if it is single.
        carried: How many times the spin its waves along and against it are carried by, seen from
            the track (:func:`carried`); None for n = 0 and without axle.
    """

    number: int
    frequency: float
    kind: str
    shares: dict[str, float]
    diameters: int | None = None
    circles: int | None = None
    purity: float | None = None
    partner: int | None = None
    split: float | None = None
    carried: float | None = None


@dataclass(frozen=True)
class Waves:
    """Amplitudes round the axle.

    Attributes:
        coefficients: Complex amplitude ``a`` of ``Re(a exp(-i n θ))`` by mode, patch, direction and
            order, shape ``(k, p, 3, ORDERS + 1)``.
        mass: Of each patch, shape ``(p,)`` [kg].
        radius: Mean of each patch, shape ``(p,)`` [m].
    """

    coefficients: npt.NDArray[np.complex128]
    mass: Array
    radius: Array

    @property
    def energy(self) -> Array:
        """Part of ``φᵀ M φ`` by mode and order, shape ``(k, ORDERS + 1)``."""
        half = np.where(np.arange(ORDERS + 1) == 0, 1.0, 0.5)
        square = np.abs(self.coefficients) ** 2
        return np.asarray(np.einsum("kpcn,p->kn", square, self.mass) * half)


def cylindrical(points: Array, shapes: Array, point: Array, axis: Array) -> tuple[Array, ...]:
    """Return axial position, radius, angle, and shapes as axial, radial, circumferential.

    The angle is counted from the lowest point, towards the circumferential direction.

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        shapes: Modes, shape ``(k, n, 3)``.
        point: A point of the axle [m].
        axis: Its direction.
    """
    down = np.array([0.0, 0.0, -1.0])
    down -= (down @ axis) * axis
    down /= np.linalg.norm(down)
    ahead = np.cross(down, axis)
    x = points - point
    angle = np.arctan2(x @ ahead, x @ down)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    frame = np.stack([np.broadcast_to(axis, x.shape), c * down + s * ahead, c * ahead - s * down])
    turned = np.einsum("kni,cni->knc", shapes, frame)
    return x @ axis, np.hypot(x @ ahead, x @ down), angle, turned


def waves(y: Array, r: Array, angle: Array, mass: Array, shapes: Array) -> Waves:
    """Return the amplitudes of all orders, patch by patch.

    Args:
        y: Axial position of the nodes, shape ``(n,)`` [m].
        r: Their radius [m].
        angle: Their angle [rad].
        mass: Their mass [kg].
        shapes: Modes as axial, radial, circumferential motion, shape ``(k, n, 3)``.
    """
    patches = patched(y, r)
    coefficients = np.zeros((len(shapes), len(patches), 3, ORDERS + 1), dtype=complex)
    for p, nodes in enumerate(patches):
        # shorter waves than two of the widest gap would fit anything
        around = np.unique(np.round(angle[nodes], 6))
        gap = np.diff(around, append=around[0] + 2 * np.pi).max()
        orders = np.arange(min(ORDERS, int(np.ceil(np.pi / gap - 1e-3)) - 1) + 1)
        phase = np.outer(angle[nodes], orders)
        basis = np.hstack([np.cos(phase), np.sin(phase[:, 1:])])
        root = np.sqrt(mass[nodes])[:, None]
        fit = np.linalg.pinv(root * basis, rcond=1e-8) * root.T
        found = np.einsum("bn,knc->kcb", fit, shapes[:, nodes])
        coefficients[:, p, :, : len(orders)] = found[..., : len(orders)]
        coefficients[:, p, :, 1 : len(orders)] += 1j * found[..., len(orders) :]
    total = np.array([mass[nodes].sum() for nodes in patches])
    radius = np.array([mass[nodes] @ r[nodes] for nodes in patches]) / total
    return Waves(coefficients, total, radius)


def patched(y: Array, r: Array) -> list[npt.NDArray[np.int64]]:
    """Return the nodes of each ring, or of each patch of the section if they lie in no rings."""
    for width in (1e-6, PATCH):
        place = np.round(np.column_stack([y, r]) / width).astype(np.int64)
        _, patch = np.unique(place, axis=0, return_inverse=True)
        count = patch.max() + 1
        if len(y) >= 16 * count:
            break
    order = np.argsort(patch, kind="stable")
    return np.split(order, np.cumsum(np.bincount(patch))[:-1])


def circles(found: Waves, k: int, n: int, inner: float) -> int:
    """Return the sign changes of the axial motion of mode ``k`` from ``inner`` outward.

    Args:
        found: Amplitudes.
        k: The mode, from 0.
        n: Its order.
        inner: Radius of the hub [m].
    """
    outside = found.radius > inner
    a, mass, r = found.coefficients[k, outside, 0, n], found.mass[outside], found.radius[outside]
    a = a * np.exp(-0.5j * np.angle((mass * a**2).sum()))  # its own phase: a standing wave
    edges = np.linspace(inner, r.max() * (1 + 1e-9), BINS + 1)
    bin_of = np.clip(np.digitize(r, edges) - 1, 0, BINS - 1)
    weight = np.bincount(bin_of, mass, BINS)
    used = weight > 0
    along = np.bincount(bin_of, mass * a.real, BINS)[used] / weight[used]
    signs = np.sign(along[np.abs(along) > STILL * np.abs(along).max()])
    return int((signs[1:] != signs[:-1]).sum())


def carried(found: Waves, k: int, n: int) -> float:
    """Return by how many times the spin the waves of mode ``k`` are carried, seen from the track.

    A body of revolution that turns by Ω carries a wave of n nodal diameters round with n Ω, but
    Coriolis forces hold it back by ``2 Im Σ m a_r* a_c / Σ m |a|²`` times Ω of radial and
    circumferential motion (G. H. Bryan, Proc. Cambridge Philos. Soc. 7, 1890): a thin ring by
    ``2 n / (n² + 1)`` of n, axial motion not at all. To first order in Ω over the frequency.

    Args:
        found: Amplitudes.
        k: The mode, from 0.
        n: Its order.
    """
    a = found.coefficients[k, :, :, n]
    swirl = 2 * float(found.mass @ (a[:, 1].conj() * a[:, 2]).imag)
    return n + swirl / float(found.mass @ (np.abs(a) ** 2).sum(axis=1))


def paired(modes: list[Mode], found: Waves) -> list[Mode]:
    """Return the modes with partners: neighbours of the same order whose sections look alike."""
    out = list(modes)
    for i, mode in enumerate(modes):
        if not mode.diameters or out[i].partner:
            continue
        j = next((j for j in range(i + 1, len(modes)) if modes[j].diameters == mode.diameters), -1)
        if j < 0 or not alike(found, i, j, mode.diameters):
            continue
        f, g = mode.frequency, modes[j].frequency
        split = 2 * (g - f) / (g + f)
        if split < PAIRED:
            out[i] = replace(mode, partner=j + 1, split=split)
            out[j] = replace(modes[j], partner=i + 1, split=split)
    return out


def alike(found: Waves, i: int, j: int, n: int) -> bool:
    """Tell whether two modes of order n have the same section."""
    a, b = (
        (np.abs(found.coefficients[k, :, :, n]) * np.sqrt(found.mass)[:, None]).ravel()
        for k in (i, j)
    )
    return bool(a @ b > ALIKE * np.linalg.norm(a) * np.linalg.norm(b))


def turned(shapes: Array, modes: list[Mode], found: Waves) -> Array:
    """Return the shapes with the phase of even pairs chosen and all signs.

    The first of a pair then is largest at the bottom, whatever the solver returned.
    """
    out = shapes.copy()
    for i, mode in enumerate(modes):
        if mode.partner and mode.split < EVEN and mode.partner > mode.number:  # type: ignore[operator]
            j, n = mode.partner - 1, mode.diameters
            part = found.coefficients[[i, j], :, :2, n]
            c = int(np.argmax((np.abs(part) ** 2 * found.mass[:, None]).sum(axis=(0, 1))))
            sine, cosine = part[..., c].imag, part[..., c].real
            _, turn = np.linalg.eigh((sine * found.mass) @ sine.T)
            out[[i, j]] = np.einsum("kl,lni->kni", turn.T, shapes[[i, j]])
            for row, column, waves_of in ((i, 0, cosine), (j, 1, sine)):
                heavy = int(np.argmax(np.abs(turn[:, column] @ waves_of)))
                if turn[:, column] @ waves_of[:, heavy] < 0:
                    out[row] *= -1
        elif not (mode.partner and mode.split < EVEN):  # type: ignore[operator]
            flat = out[i].ravel()
            if flat[np.argmax(np.abs(flat))] < 0:
                out[i] *= -1
    return out


def labelled(
    frequencies: Array,
    shapes: Array,
    points: Array,
    mass: Array,
    axle: tuple[Array, Array] | None,
    hub: float | None = None,
) -> tuple[list[Mode], Array]:
    """Return what each mode is, and the shapes with the phases of even pairs chosen.

    Args:
        frequencies: Ascending, shape ``(k,)`` [Hz].
        shapes: Modes, shape ``(k, n, 3)``.
        points: Node positions, shape ``(n, 3)`` [m].
        mass: Their mass, shape ``(n,)`` [kg].
        axle: Point and direction of the axle, if there is one.
        hub: Radius from which on nodal circles are counted; a third of the largest if None [m].
    """
    if axle is None:
        return [
            _plain(i, f, s, mass) for i, (f, s) in enumerate(zip(frequencies, shapes, strict=True))
        ], shapes
    y, r, angle, moved = cylindrical(points, shapes, *axle)
    found = waves(y, r, angle, mass, moved)
    energy, outer = found.energy, r > 0.85 * r.max()
    hub = r.max() / 3 if hub is None else hub
    modes = []
    for i, f in enumerate(frequencies):
        share = np.einsum("nc,n->c", moved[i] ** 2, mass)
        rim = np.einsum("nc,n->c", moved[i, outer] ** 2, mass[outer])
        shares = dict(zip(NAMES, (share / share.sum()).tolist(), strict=True))
        if f < RIGID:
            modes.append(Mode(i + 1, float(f), "rigid", shares))
            continue
        n = int(np.argmax(energy[i]))
        purity = float(energy[i, n] / share.sum())
        kind = NAMES[int(np.argmax(rim))]
        m = circles(found, i, n, hub) if shares["axial"] > NO_AXIAL else None
        turns = carried(found, i, n) if n else None
        modes.append(Mode(i + 1, float(f), kind, shares, n, m, purity, carried=turns))
    modes = paired(modes, found)
    return modes, turned(shapes, modes, found)


def _plain(i: int, frequency: float, shape: Array, mass: Array) -> Mode:
    """Return the label of a mode of a body without axle."""
    share = np.einsum("nc,n->c", shape**2, mass)
    shares = dict(zip("xyz", (share / share.sum()).tolist(), strict=True))
    kind = "rigid" if frequency < RIGID else f"along {'xyz'[int(np.argmax(share))]}"
    return Mode(i + 1, float(frequency), kind, shares)
