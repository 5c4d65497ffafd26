"""Define what tables of the scenario language consist of: keys and value types."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime
from math import inf, isfinite
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    Optional,
    Self,
    TypeVar,
    get_origin,
)

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    FiniteFloat,
    ModelWrapValidatorHandler,
    PrivateAttr,
    Tag,
    model_validator,
)
from pydantic_core import PydanticCustomError

from ..system.errors import DesatError
from ..system.parameters import unit_of

# Use of a key at the top of a scenario. `text`: it is for people, travels in manifests and
# .ssp, and affects no bit. `run`: it travels and counts in the digest. `resolved`: it
# travels and counts in the system into which it is resolved. `system`: it is resolved into
# the system, which travels. `file`: it concerns only the file.
Use = Literal["text", "run", "resolved", "system", "file"]
TRAVELS: tuple[Use, ...] = ("text", "run", "resolved")


class Declared(NamedTuple):
    """Properties of a key besides its type.

    They are unit, use, and whether a file that extends another inherits it.
    """

    unit: str = ""
    use: Use | None = None
    inherited: bool = True


def key(
    text: str,
    unit: str = "",
    default: Any = None,
    *,
    use: Use | None = None,
    inherited: bool = True,
    **limits: Any,
) -> Any:
    """Declare a key of the language, with its sentence and its `Declared` properties.

    `default` is the value of a key that a file does not contain. By convention it is
    the empty value of the type ("", (), {}, False) where a file may not contain that,
    and None elsewhere, so that a missing key differs from each value in a file.
    """
    field_info = Field(default, description=text, **limits)
    field_info.metadata.append(Declared(unit, use, inherited))
    return field_info


def declared(table: type[BaseModel]) -> dict[str, Declared]:
    """Return the declared properties of each key of a table."""
    declarations = {
        n: [x for x in f.metadata if isinstance(x, Declared)]
        for n, f in table.model_fields.items()
    }
    return {name: (x or [Declared()])[0] for name, x in declarations.items()}


def _one_line(text: str) -> str:
    """Check that a text is not empty and has no NUL."""
    if not text.strip() or "\0" in text:
        raise ValueError("a text with something in it is needed")
    return text


def _known_unit(text: str) -> str:
    """Check that a text is a known unit."""
    try:
        unit_of(_one_line(text))
    except DesatError as error:
        raise ValueError(str(error)) from error
    return text


def _a_value(value: Any) -> Any:
    """Check that a value is a number, a text, true or false, or lists of these."""
    for x in value if isinstance(value, list) else [value]:
        if isinstance(x, list):
            _a_value(x)
        elif not isinstance(x, (bool, int, float, str)):
            raise ValueError(
                "a number, a text, true or false, or lists of these are needed"
            )
    return value


def utc(value: datetime) -> datetime:
    """Check that a time has a time zone."""
    if value.tzinfo is None:
        raise ValueError("a UTC time is needed, 2026-01-01T00:00:00Z")
    return value


def by_kind(value: Any) -> str:
    """Return the tag of a value's kind for a union of kinds."""
    names = {dict: "<table>", list: "<list>", str: "<text>"}
    return next(
        (name for kind, name in names.items() if isinstance(value, kind)), "<number>"
    )


def either(**kinds: Any) -> Any:
    """Build a type for values of one of several kinds.

    The kinds (`table`, `list`, `text`, `number`) are distinguished by the type of the
    value.
    """
    union: Any = None
    for name, kind in kinds.items():
        member: Any = Annotated[kind, Tag(f"<{name}>")]
        union = member if union is None else union | member
    return Annotated[union, Discriminator(by_kind)]


def _deviation(values: Sequence[float]) -> Sequence[float]:
    """Check that the deviation is not negative."""
    if values[1] < 0.0:
        raise ValueError(f"the deviation is {values[1]:g}; at least 0 is needed")
    return values


T = TypeVar("T")
Text = Annotated[str, AfterValidator(_one_line)]
Unit = Annotated[str, AfterValidator(_known_unit)]
Value = Annotated[Any, AfterValidator(_a_value)]
Many = Annotated[tuple[T, ...], Field(strict=False)]  # a list, stored as a tuple
Band = Annotated[Many[FiniteFloat], Field(min_length=2, max_length=2)]
MeanAndDeviation = Annotated[Band, AfterValidator(_deviation)]
Three = Annotated[Many[FiniteFloat], Field(min_length=3, max_length=3)]
if TYPE_CHECKING:
    Maybe = Optional[T]  # noqa: UP045
    NumberOrText = float | str
    TextOrTexts = tuple[str, ...]
else:

    class Maybe:
        """A value that may be left out and is None then; None cannot be written."""

        def __class_getitem__(cls, kind: Any) -> Any:
            return kind

    NumberOrText = either(number=FiniteFloat, text=Text)
    TextOrTexts = Annotated[
        either(text=Text, list=Annotated[Many[Text], Field(min_length=1)]),
        AfterValidator(lambda x: (x,) if isinstance(x, str) else x),
    ]


def ordered(band: Sequence[float]) -> Sequence[float]:
    """Check that a range is finite and its first value is not above its second."""
    if band[0] > band[1]:
        raise ValueError(f"the first, {band[0]:g}, is above the second, {band[1]:g}")
    if not isfinite(band[1] - band[0]):
        raise ValueError("they are too far apart")
    return band


def width(text: str) -> str:
    """Check a width about the paper's value: `3 %`, `0.02`, or an empty text."""
    if text and not re.fullmatch(r"\d+(\.\d*)?(e-?\d+)? ?%?", text.strip()):
        raise ValueError('a width is needed, "3 %" or "0.02", or [low, high]')
    return text


def bounds(band: Sequence[float]) -> Sequence[float]:
    """Check a range as `ordered` does, or one that is open at one end.

    An open end is -inf first or inf second.
    """
    low, high = band
    if (low == -inf and isfinite(high)) or (isfinite(low) and high == inf):
        return band
    return ordered(band)


Range = Annotated[Band, AfterValidator(ordered)]
Bounds = Annotated[
    Annotated[Many[float], Field(min_length=2, max_length=2)], AfterValidator(bounds)
]


def incomplete(text: str) -> PydanticCustomError:
    """Build the error of a table that is wrong as a whole.

    The same table may be right as a part that others complete.
    """
    return PydanticCustomError("incomplete", "{text}", {"text": text})


class LanguageTable(BaseModel):
    """Table of the language.

    It is frozen, has no other keys and does not convert types.
    """

    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, defer_build=True
    )
    # keys that a whole table has; a part, which others complete, may lack them
    NEEDED: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        for field in cls.model_fields.values():
            kind = get_origin(field.annotation) or field.annotation
            if field.default is None and kind in (str, tuple, dict, bool):
                field.default = kind()

    @model_validator(mode="after")
    def _needed(self) -> Self:
        """Check that a whole table has all needed keys."""
        if missing := [
            name for name in self.NEEDED if name not in self.model_fields_set
        ]:
            raise incomplete(f"{', '.join(missing)} missing")
        return self


class Written(LanguageTable):
    """Table that is stored in JSON, or in a digest, as it was written."""

    _written: dict[str, Any] = PrivateAttr(default_factory=dict)

    @property
    def written(self) -> dict[str, Any]:
        """Return the table as it was written, for JSON and digests; read-only."""
        return self._written

    @model_validator(mode="wrap")
    @classmethod
    def _keep(cls, data: Any, read: ModelWrapValidatorHandler[Self]) -> Self:
        """Store the data from which the table was read."""
        converted = read(data)
        if converted is not data:
            converted._written = data
        return converted
