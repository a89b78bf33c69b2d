# SPDX-License-Identifier: LGPL-3.0-or-later
"""J2 plasticity with isotropic and kinematic hardening, in UFL.

Flow stress ``Y + H p + Q (1 − exp(−b p))`` (linear and Voce hardening) of the equivalent plastic
strain p; the yield surface moves with N back stresses after Armstrong and Frederick,
``Ẋ = 2/3 C ε̇_p − γ X ṗ`` (linear for γ = 0), as Chaboche combines them. Radial return; where
hardening is linear in closed form, else by Newton's method on the increment of p alone (Kobayashi
and Ohno, Int. J. Numer. Meth. Engng 53, 2002, 2217–2238):

    √(3/2) ‖s − Σ θ X‖ = Y(p + Δp) + (3 μ + Σ θ C) Δp,    θ = 1 / (1 + γ Δp).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from ufl import conditional, dev, exp, gt, inner, sqrt

from forms.elasticity import Elastic
from forms.materials import hooke_energy
from forms.memory import EQUIVALENT, PLASTIC, Memory, MemoryLaw, Variable

RECOVERED = "recovered"  # what dynamic recovery has lost [J/m³]
TINY = 1e-30  # of the modulus, squared: keeps the root of no stress away from a division by zero
ITERATIONS = 3  # of Newton's method: 1e-10 left where γ Δp is 0.004, as in usual steps


@dataclass(frozen=True)
class BackStress:
    """A back stress after Armstrong and Frederick.

    Attributes:
        modulus: C, its first slope [Pa].
        recall: γ; its largest value is C / γ; 0 for linear kinematic hardening [-].
    """

    modulus: float
    recall: float = 0.0


@dataclass(frozen=True)
class ElastoPlastic(Elastic):
    """Isotropic elasticity with J2 plasticity.

    Attributes:
        yield_stress: Y, the first flow stress [Pa].
        hardening_modulus: H, of linear isotropic hardening [Pa].
        saturation_stress: Q, by which Voce's hardening raises the flow stress in the end [Pa].
        saturation_rate: b, how fast [-].
        back_stresses: Kinematic hardening.

    Raises:
        ValueError: for a yield stress that is not between 0 and Young's modulus, hardening below 0
            (softening localises in one row of cells), or one of the two constants of Voce.
    """

    yield_stress: float = np.nan
    hardening_modulus: float = 0.0
    saturation_stress: float = 0.0
    saturation_rate: float = 0.0
    back_stresses: tuple[BackStress, ...] = ()

    def __post_init__(self) -> None:
        if not 0 < self.yield_stress < self.E:
            raise ValueError(
                f"yield_stress = {self.yield_stress:g} Pa: expected above 0 and less than Young's "
                f"modulus, {self.E:g} Pa"
            )
        least = min(
            self.hardening_modulus,
            self.saturation_stress,
            self.saturation_rate,
            *(b.recall for b in self.back_stresses),
        )
        if least < 0 or any(b.modulus <= 0 for b in self.back_stresses):
            raise ValueError("hardening: expected moduli and rates of at least 0; no softening")
        if (self.saturation_stress > 0) != (self.saturation_rate > 0):
            raise ValueError(
                "saturation_stress, saturation_rate: expected both above 0, or neither, got "
                f"{self.saturation_stress:g} Pa and {self.saturation_rate:g}"
            )


def history(material: ElastoPlastic) -> dict[str, Variable]:
    """Plastic strain, equivalent plastic strain, back stresses, and what their recovery lost."""
    symmetric = Variable((3, 3), symmetric=True)
    variables = {PLASTIC: symmetric, EQUIVALENT: Variable()}
    variables |= {_back(k): symmetric for k in range(len(material.back_stresses))}
    if any(b.recall for b in material.back_stresses):
        variables[RECOVERED] = Variable()
    return variables


def flow_stress(p: Any, material: ElastoPlastic) -> Any:
    """Flow stress of isotropic hardening [Pa]."""
    stress = material.yield_stress + material.hardening_modulus * p
    if material.saturation_stress:
        stress += material.saturation_stress * (1 - exp(-material.saturation_rate * p))
    return stress


def update(strain: Any, old: Memory, material: ElastoPlastic) -> tuple[Any, dict[str, Any]]:
    """Return the stress and the new history of a strain (radial return)."""
    mu, backs = material.mu, material.back_stresses
    trial = material.stress(strain - old[PLASTIC])
    X = [old[_back(k)] for k in range(len(backs))]
    increment, direction, share = _flow(dev(trial), X, old[EQUIVALENT], material)
    flow = increment * direction
    new = {PLASTIC: old[PLASTIC] + flow, EQUIVALENT: old[EQUIVALENT] + increment}
    recovered = old.get(RECOVERED)
    for k, (b, theta) in enumerate(zip(backs, share, strict=True)):
        new[_back(k)] = theta * (X[k] + 2 / 3 * b.modulus * flow)
        if b.recall:  # the work on the back stress, less what it stores of it
            stored = 3 / 4 / b.modulus * (inner(new[_back(k)], new[_back(k)]) - inner(X[k], X[k]))
            recovered += inner(new[_back(k)], flow) - stored
    if recovered is not None:
        new[RECOVERED] = recovered
    return trial - 2 * mu * flow, new


def _flow(s: Any, X: list[Any], p: Any, material: ElastoPlastic) -> tuple[Any, Any, list[Any]]:
    """Return ``Δp``, the direction of the plastic strain, and the share θ kept of back stresses."""
    backs = material.back_stresses
    if not material.saturation_stress and not any(b.recall for b in backs):
        xi = s - sum(X) if X else s
        size = _size(inner(xi, xi), material)
        beyond = size - flow_stress(p, material)
        slope = 3 * material.mu + material.hardening_modulus + sum(b.modulus for b in backs)
        increment = conditional(gt(beyond, 0), beyond * (1 / slope), 0.0)
        return increment, (1.5 / size) * xi, [1.0] * len(X)
    increment = _newton(s, X, p, material)
    share = [_share(b, increment) for b in backs]
    xi = s - sum(theta * x for theta, x in zip(share, X, strict=True)) if X else s
    return increment, (1.5 / _size(inner(xi, xi), material)) * xi, share


def _newton(s: Any, X: list[Any], p: Any, material: ElastoPlastic) -> Any:
    """Return the increment of the equivalent plastic strain, 0 in an elastic step."""
    backs, mu = material.back_stresses, material.mu
    rate, Q = material.saturation_rate, material.saturation_stress
    sX = [inner(s, x) for x in X]
    XX = [[inner(x, y) for y in X[: i + 1]] for i, x in enumerate(X)]
    ss = inner(s, s)

    def pair(i: int, j: int) -> Any:
        return XX[max(i, j)][min(i, j)]

    def iterate(dp: Any) -> tuple[Any, Any]:
        """Return the residual at an increment, and its slope."""
        theta = [_share(b, dp) for b in backs]
        square, change = ss, 0.0
        for i, b in enumerate(backs):
            along = sum(theta[j] * pair(i, j) for j in range(len(backs))) - sX[i]
            square += theta[i] * (along - sX[i])
            change -= b.recall * theta[i] ** 2 * along
        size = _size(square, material)
        hard = 3 * mu + sum(b.modulus * t for b, t in zip(backs, theta, strict=True))
        residual = size - flow_stress(p + dp, material) - hard * dp
        slope = 1.5 * change / size - material.hardening_modulus - 3 * mu
        slope -= sum(b.modulus * t**2 for b, t in zip(backs, theta, strict=True))
        if Q:
            slope -= Q * rate * exp(-rate * (p + dp))
        return residual, slope

    beyond, slope = iterate(0.0)
    increment = -beyond / slope
    for _ in range(ITERATIONS - 1):
        residual, slope = iterate(increment)
        increment = increment - residual / slope
    return conditional(gt(beyond, 0), increment, 0.0)


def _share(back: BackStress, increment: Any) -> Any:
    """Return the share of a back stress that recovery leaves."""
    return 1 / (1 + back.recall * increment) if back.recall else 1.0


def _size(square: Any, material: ElastoPlastic) -> Any:
    """Return the equivalent stress of a deviatoric stress, from its square, never 0 [Pa]."""
    return sqrt(1.5 * square + TINY * material.mu**2)


def energy(strain: Any, history: Memory, material: ElastoPlastic) -> dict[str, Any]:
    """Return elastic energy, that stored by hardening, and dissipation [J/m³].

    All work of hardening but dynamic recovery counts as stored. In a metal most of it is heat; the
    ledger does not depend on how they share it.
    """
    p = history[EQUIVALENT]
    hardening = material.hardening_modulus / 2 * p**2
    if material.saturation_stress:
        b = material.saturation_rate
        hardening += material.saturation_stress * (p + (exp(-b * p) - 1) / b)
    for k, back in enumerate(material.back_stresses):
        hardening += 3 / 4 / back.modulus * inner(history[_back(k)], history[_back(k)])
    return {
        "internal": hooke_energy(strain - history[PLASTIC], material),
        "hardening": hardening,
        "plastic_dissipation": material.yield_stress * p + history.get(RECOVERED, 0.0),
    }


def excess(strain: Any, history: Memory, material: ElastoPlastic) -> Any:
    """Return by which share of the yield stress a state is beyond the yield surface [-]."""
    s = 2 * material.mu * dev(strain - history[PLASTIC])
    backs = range(len(material.back_stresses))
    xi = s - sum(history[_back(k)] for k in backs) if backs else s
    beyond = _size(inner(xi, xi), material) - flow_stress(history[EQUIVALENT], material)
    return beyond / material.yield_stress


def _back(k: int) -> str:
    return f"back_stress_{k + 1}"


J2 = MemoryLaw(history, update, energy, excess)
MEMORY_LAWS = {"j2": J2}
