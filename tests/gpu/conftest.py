"""The full network with the reference weights."""

from tests.parity.conftest import full, state_dict  # noqa: F401
