"""The compiled model, in which fits take a third of the time."""

import pytest

from ccr_host.control.adaptive.compiled import CompiledModel


@pytest.fixture(scope="session")
def compiled() -> CompiledModel:
    return CompiledModel()
