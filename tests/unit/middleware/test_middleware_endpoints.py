"""Promise: of an endpoint in another process, a run never takes it for its own."""

from __future__ import annotations

import pytest

from r2bspec.middleware.middleware import middleware_named

# As rmw_fastrtps_cpp gave it in process 27027 (0x6993).
GID = bytes.fromhex("010f78fd9369c5870000000000001303")


@pytest.mark.parametrize("rmw", ["rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp"])
def test_fast_dds_tells_the_process_of_an_endpoint(rmw: str) -> None:
    middleware = middleware_named(rmw)
    assert middleware.may_be_endpoint_of(GID, [1, 27027])
    # Only the low 16 bits are in the identifier.
    assert middleware.may_be_endpoint_of(GID, [27027 + 3 * 65536])
    assert not middleware.may_be_endpoint_of(GID, [1, 27028])
    assert not middleware.may_be_endpoint_of(GID, [])
    # An identifier of another vendor.
    assert not middleware.may_be_endpoint_of(b"\x01\x10" + GID[2:], [27027])


@pytest.mark.parametrize("rmw", ["rmw_cyclonedds_cpp", "rmw_zenoh_cpp"])
def test_of_others_nothing_is_known(rmw: str) -> None:
    assert middleware_named(rmw).may_be_endpoint_of(GID, [])
