# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers with units: the types of a scene's fields, and the message when a value does not fit."""

import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError

LEAST, MOST = 1e-18, 1e18  # squares, products and quotients of such numbers are finite


def _not_huge(value: float) -> float:
    if abs(value) > MOST:
        raise PydanticCustomError("size", f"a size of at most {MOST:g}")
    return value


def _not_tiny(value: float) -> float:
    if value < LEAST:
        raise PydanticCustomError("size", f"a size of at least {LEAST:g}")
    return value


BOUNDED, SIZED = AfterValidator(_not_huge), AfterValidator(_not_tiny)


def _number(unit: str, **limits: Any) -> Any:
    return Field(strict=True, allow_inf_nan=False, json_schema_extra={"unit": unit}, **limits)


Length = Annotated[float, _number("m", gt=0), BOUNDED, SIZED]
Distance = Annotated[float, _number("m", ge=0), BOUNDED]
Position = Annotated[float, _number("m"), BOUNDED]
Angle = Annotated[float, _number("rad", ge=-0.2, le=0.2), BOUNDED]
Slope = Annotated[float, _number("-", ge=0, le=0.2), BOUNDED]
Duration = Annotated[float, _number("s", gt=0), BOUNDED, SIZED]
Delay = Annotated[float, _number("s", ge=0), BOUNDED]
Minutes = Annotated[float, _number("min", ge=0), BOUNDED]
Mass = Annotated[float, _number("kg", gt=0), BOUNDED, SIZED]
Modulus = Annotated[float, _number("Pa", gt=0), BOUNDED, SIZED]
Stress = Annotated[float, _number("Pa"), BOUNDED]
Force = Annotated[float, _number("N"), BOUNDED]
Hardening = Annotated[float, _number("Pa", ge=0), BOUNDED]
Ratio = Annotated[float, _number("-", ge=0, lt=0.5), BOUNDED]
Density = Annotated[float, _number("kg/m^3", gt=0), BOUNDED, SIZED]
Speed = Annotated[float, _number("m/s"), BOUNDED]
Spin = Annotated[float, _number("rad/s"), BOUNDED]
Acceleration = Annotated[float, _number("m/s^2"), BOUNDED]
Stiffness = Annotated[float, _number("N/m", ge=0), BOUNDED]
Damping = Annotated[float, _number("N s/m", ge=0), BOUNDED]
Rate = Annotated[float, _number("1/s", ge=0), BOUNDED]
Friction = Annotated[float, _number("-", ge=0), BOUNDED]
SlipRate = Annotated[float, _number("m/s", ge=0), BOUNDED]
SlipSpeed = Annotated[float, _number("m/s", gt=0), BOUNDED, SIZED]
Factor = Annotated[float, _number("-", gt=0), BOUNDED, SIZED]
Tolerance = Annotated[float, _number("-", gt=0)]
Share = Annotated[float, _number("-", ge=0), BOUNDED]
Growth = Annotated[float, _number("-", ge=1, le=2), BOUNDED]
Component = Annotated[float, _number("-"), BOUNDED]
Step = Annotated[float, _number("-", gt=0, le=1.2), BOUNDED, SIZED]
Shrinkage = Annotated[float, _number("-", gt=0, lt=1)]
Number = Annotated[float, _number("-"), BOUNDED]  # of any unit
Count = Annotated[int, Field(ge=1, strict=True, json_schema_extra={"unit": "-"})]
Direction = Literal["x", "y", "z", "axle"]

LONGEST_NAME = 100  # bytes: room for what is put around it, in file names of 255


def folder_name(name: str) -> str:
    """Return a name that is one of a folder too, and of none but that."""
    if (length := len(name.encode(errors="replace"))) > LONGEST_NAME:
        raise ValueError(
            f"name = {name[:20] + '…'!r}: expected at most {LONGEST_NAME} bytes, got {length}"
        )
    if not re.fullmatch(r"\w[^/\\\x00-\x1f\x7f\ud800-\udfff]*", name):
        raise ValueError(
            f"name = {name!r}: expected the name of a folder, which begins with a letter or digit "
            "and has no '/' or '\\'"
        )
    return name


Name = Annotated[str, AfterValidator(folder_name)]


class SceneError(ValueError):
    """A scene that cannot be run: the message names the key, what it got and what it expects."""


class Section(BaseModel):
    """A table of a scene; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def explain(error: Any, data: Any, root: type[BaseModel]) -> str:
    """Return one line for a pydantic error: the dotted key, what it got, what it expects."""
    keys: list[str] = []
    for depth, part in enumerate(error["loc"], 1):
        absent = error["type"] == "missing" and depth == len(error["loc"])
        if isinstance(data, Mapping) and (part in data or absent):
            data = data.get(part)
        elif isinstance(data, list | tuple) and isinstance(part, int) and part < len(data):
            data = data[part]
        else:
            continue  # the tag of a union, not a key
        keys.append(str(part))
    key = ".".join(keys) or "scene"
    unit = unit_of(root, keys)
    unit = f" [{unit}]" if unit else ""
    if error["type"] == "value_error":
        table = (
            f"{'.'.join(map(str, error['loc'][:-2]))}: " if error["loc"][-1:] == ("[key]",) else ""
        )
        return f"{table}{error['ctx']['error']}"
    if error["type"] == "missing":
        return f"{key}: missing; expected a value{unit}"
    if error["type"] == "extra_forbidden":
        return f"{key} = {error['input']!r}: unknown key"
    expected = error["msg"].removeprefix("Input should be ")
    return f"{key} = {error['input']!r}: expected {expected}{unit}"


def unit_of(annotation: Any, keys: list[str]) -> str:
    """Return the unit of the field at ``keys`` below a model or type, empty if it has none."""
    if get_origin(annotation) is Annotated:
        base, *notes = get_args(annotation)
        own = [n.json_schema_extra for n in notes if getattr(n, "json_schema_extra", None)]
        return str(own[0]["unit"]) if own and not keys else unit_of(base, keys)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        field = annotation.model_fields.get(keys[0]) if keys else None
        if field is None:
            return ""
        extra = field.json_schema_extra
        if isinstance(extra, dict) and len(keys) == 1:
            return str(extra["unit"])
        return unit_of(field.annotation, keys[1:])
    inner = keys
    if get_origin(annotation) in (list, tuple, dict) and keys:
        inner = keys[1:]
    return next((unit for a in get_args(annotation) if (unit := unit_of(a, inner))), "")


def takes_text(root: type[BaseModel], keys: list[str]) -> bool:
    """Tell whether the field at ``keys`` below a model holds text and nothing else."""
    return kinds(root, keys) - {type(None)} == {str}


def kinds(annotation: Any, keys: list[str]) -> set[Any]:
    """Return the types that a value at ``keys`` below a model or type may have."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return kinds(inner[0], keys)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel) and keys:
        field = annotation.model_fields.get(keys[0])
        return kinds(field.annotation, keys[1:]) if field else set()
    if origin is Literal:
        return set() if keys else {type(choice) for choice in inner}
    if origin in (list, tuple, dict):
        return kinds(inner[-1], keys[1:]) if keys else {origin}
    if inner:  # a union
        return set().union(*(kinds(each, keys) for each in inner))
    return set() if keys else {annotation}
