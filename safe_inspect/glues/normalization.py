"""The `normalization` block of a glue."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from safe_inspect.glues.normalizers import Normalizer
from safe_inspect.plugins.functor import build


class Normalization(BaseModel):
    """Configuration of a glue's normaliser.

    Attributes:
        enabled: If False, the values are not normalised.
        normalizer: Name of the normaliser.
        config: Fields of the normaliser.
        output_units: A key of safe-autonomy-sims, which has no effect there or here.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    enabled: bool = True
    normalizer: str = "LinearNormalizer"
    config: dict[str, Any] = Field(default_factory=dict)
    output_units: Any = None

    @field_validator("config", mode="before")
    @classmethod
    def _nothing(cls, value: Any) -> Any:
        return {} if value is None else value

    @model_validator(mode="after")
    def _check_normalizer(self) -> Normalization:
        assert self.active is not None or not self.enabled  # a wrong normaliser is found now
        return self

    @cached_property
    def active(self) -> Normalizer | None:
        """The normaliser, or None if normalisation is disabled.

        Raises:
            PydanticCustomError: There is no such normaliser, or a field of it is wrong.
        """
        if not self.enabled:
            return None
        try:
            made = build("normalizer", {"functor": self.normalizer, "config": self.config})
        except PydanticCustomError as error:
            problems = [
                {**problem, "loc": ("normalizer",) if problem["loc"] == ("functor",) else problem["loc"]}
                for problem in (error.context or {})["errors"]
            ]
            raise PydanticCustomError("functor", "the normaliser is wrong", {"errors": problems}) from None
        assert isinstance(made, Normalizer)
        return made
