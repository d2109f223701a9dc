"""The base of all tables of a scene file, and the types of their values."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from annotated_types import Len
from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

Pair = Annotated[list[float], Len(2, 2)]
Vector = Annotated[list[float], Len(3, 3)]
NumberOrTriple = float | Vector
NumberOrWeights = float | Vector | Annotated[list[float], Len(6, 6)]
Selector = str | list[list[int]] | list[int]

ROTATION = "Rotation about x, then y, then z (axes of the world), as Blender and USD's rotateXYZ have it"


def key(
    default: Any, description: str, *, unit: str = "", example: Any = None, words: str = "", remedy: str = ""
) -> Any:
    """A key of a table.

    Args:
        default: Its value when left out; `...` if it must be given.
        description: What it means.
        unit: Its unit.
        example: A good value. It also stands in for a bad one while the rest of the file is checked.
        words: What it must be, where its type does not say it well.
        remedy: What to write instead of a bad value, where an example does not say it well.
    """
    extra: Any = {name: text for name, text in (("unit", unit), ("words", words), ("remedy", remedy)) if text}
    examples = None if example is None else [example]
    return Field(default, description=description, examples=examples, json_schema_extra=extra or None)


class Table(BaseModel):
    """A table of the scene file; keys that are not named are refused, and so are values of another type."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)
    shorthand: ClassVar[str] = ""
    """The key that a value stands for when it is given in place of the whole table."""

    @model_validator(mode="before")
    @classmethod
    def _expand_shorthand(cls, value: Any) -> Any:
        if cls.shorthand and isinstance(value, str | list):
            return {cls.shorthand: value}
        return value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        schema = handler(core)
        if not cls.shorthand:
            return schema
        table = handler.resolve_ref_schema(schema)
        table["shorthand"] = cls.shorthand
        short = table["properties"][cls.shorthand]
        choices = [choice for choice in short["anyOf"] if choice != {"type": "null"}]
        return {"anyOf": [schema, *choices], "words": short["words"], "examples": short["examples"]}

    def given(self) -> dict[str, Any]:
        """The keys that the file gives, and their values."""
        return {name: getattr(self, name) for name in type(self).model_fields if name in self.model_fields_set}
