"""The `normalization` block of a glue."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, field_validator
from pydantic_core import PydanticCustomError

from safe_inspect.functor import build
from safe_inspect.glues.normalizers import Normalizer


class Normalization(BaseModel):
    """Which normaliser a glue applies.

    Attributes:
        enabled: False: the values pass as they are.
        normalizer: Name of the normaliser.
        config: Its fields.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    enabled: bool = True
    normalizer: str = "LinearNormalizer"
    config: dict[str, Any] = Field(default_factory=dict)
    _normalizer: Normalizer | None = PrivateAttr(default=None)

    @field_validator("config", mode="before")
    @classmethod
    def _nothing(cls, value: Any) -> Any:
        return {} if value is None else value

    def model_post_init(self, context: Any) -> None:
        """Build the normaliser, unless it is switched off."""
        if self.enabled:
            try:
                made = build("normalizer", {"functor": self.normalizer, "config": self.config})
            except PydanticCustomError as error:
                problems = [
                    {**problem, "loc": ("normalizer",) if problem["loc"] == ("functor",) else problem["loc"]}
                    for problem in (error.context or {})["errors"]
                ]
                raise PydanticCustomError("functor", "the normaliser is wrong", {"errors": problems}) from None
            assert isinstance(made, Normalizer)
            self._normalizer = made

    @property
    def active(self) -> Normalizer | None:
        """The normaliser, or None when it is switched off."""
        return self._normalizer
