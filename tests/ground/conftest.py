from __future__ import annotations

from collections.abc import Iterator

import pytest

from safe_inspect.plugins.registry import registry


@pytest.fixture
def clean_registry() -> Iterator[None]:
    """Forget the plugins that a test defines."""
    kinds = registry.kinds()
    known = {kind: dict(registry.items(kind)) for kind in kinds}
    yield
    for kind in list(registry._classes):
        registry._classes[kind] = known.get(kind, {})
