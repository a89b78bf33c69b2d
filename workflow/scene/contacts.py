# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of friction: a coefficient, or a law with or without memory."""

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from workflow.scene.units import Friction, Length, Section, SlipRate, SlipSpeed


class Memory(Section):
    """Slip over which the coefficient follows its law; below ``floor`` it follows with time."""

    length: Length = Field(examples=[1e-5])
    """Slip over which the coefficient follows its law."""
    floor: SlipSpeed = 1e-3
    """Slip rate below which it follows with time instead."""


class Exponential(Section):
    """Falls from ``static`` to ``kinetic`` as ``exp(-slip rate / decay)``."""

    law: Literal["exponential"]
    """Names this law."""
    static: Friction
    """Coefficient at no slip rate."""
    kinetic: Friction
    """Coefficient at high slip rates."""
    decay: SlipSpeed
    """Slip rate at which 1/e of the difference is left."""
    memory: Memory | None = None
    """Slip that the coefficient lags behind; left out, it follows at once."""

    def steady(self) -> Any:
        """Return the law without its memory."""
        from contact.friction import exponential

        return exponential(self.static, self.kinetic, self.decay)


class Rational(Section):
    """Falls from ``static`` to ``kinetic`` as ``1 / (1 + slip rate / speed)``."""

    law: Literal["rational"]
    """Names this law."""
    static: Friction = Field(examples=[0.5])
    """Coefficient at no slip rate."""
    kinetic: Friction = Field(examples=[0.2])
    """Coefficient at high slip rates."""
    speed: SlipSpeed = Field(examples=[0.5])
    """Slip rate at which half of the difference is left."""
    memory: Memory | None = None
    """Slip that the coefficient lags behind; left out, it follows at once."""

    def steady(self) -> Any:
        """Return the law without its memory."""
        from contact.friction import rational

        return rational(self.static, self.kinetic, self.speed)


class Tabulated(Section):
    """Through points of slip rate and coefficient, linear between, constant beyond."""

    law: Literal["tabulated"]
    """Names this law."""
    slip_rate: list[SlipRate] = Field(min_length=1, examples=[[0.0, 0.1, 1.0]])
    """Slip rates of the points, increasing."""
    coefficient: list[Friction] = Field(min_length=1, examples=[[0.5, 0.4, 0.3]])
    """Coefficient at each of them."""
    memory: Memory | None = None
    """Slip that the coefficient lags behind; left out, it follows at once."""

    def steady(self) -> Any:
        """Return the law without its memory."""
        from contact.friction import tabulated

        return tabulated(self.slip_rate, self.coefficient)


class Expression(Section):
    """An expression of ``slip_rate``, ``pressure``, ``t`` and ``previous``."""

    law: Literal["expression"]
    """Names this law."""
    expression: str = Field(examples=["0.3 * exp(-slip_rate / 0.5) + 0.1"])
    """Formula in NumPy's words, of `slip_rate` [m/s], `pressure` [Pa], `t` [s] and `previous`."""
    memory: Memory | None = None
    """Slip that the coefficient lags behind; left out, it follows at once."""

    def steady(self) -> Any:
        """Return the law without its memory."""
        from contact.expression import expression

        return expression(self.expression)


LAWS = ("exponential", "rational", "tabulated", "expression")


def _kind(friction: Any) -> str | None:
    """Return which kind of friction is meant, None if it is none."""
    if isinstance(friction, Section):
        return f"{getattr(friction, 'law', None)} law"
    if isinstance(friction, dict):
        law = friction.get("law")
        return f"{law} law" if law in LAWS else None  # unlike the name of any key
    return None if isinstance(friction, str | list) else "coefficient"


FrictionLaw = Annotated[
    Annotated[Friction, Tag("coefficient")]
    | Annotated[Exponential, Tag("exponential law")]
    | Annotated[Rational, Tag("rational law")]
    | Annotated[Tabulated, Tag("tabulated law")]
    | Annotated[Expression, Tag("expression law")],
    Discriminator(
        _kind,
        custom_error_type="friction_law",
        custom_error_message=f"a number >= 0 or a table with law = one of {list(LAWS)}",
    ),
]


def law_of(friction: Any) -> Any:
    """Return the law of a friction entry, tried on all slip rates and pressures.

    Raises:
        ValueError: if it is not defined, negative or not finite somewhere.
    """
    from contact.friction import as_law, tried, with_memory

    if not isinstance(friction, Section):
        return tried(as_law(friction))
    table: Any = friction
    law = tried(table.steady())
    memory: Memory | None = table.memory
    return law if memory is None else with_memory(law, memory.length, memory.floor)
