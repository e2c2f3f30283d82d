"""Which middleware an environment selects, and what can be asked of it."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import r2bspec.middleware
from r2bspec.middleware.middleware import (
    DISCOVERY_VARIABLES,
    MessageTransport,
    Middleware,
    TransportKind,
    inherited_variables,
    known_middlewares,
    middleware_named,
    refuse_transport,
)

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "middleware.md"
KINDS: tuple[TransportKind, ...] = ("inherit", "shared_memory", "udp")
EVERY_ONE = pytest.mark.parametrize(
    "middleware",
    [*known_middlewares(), middleware_named("rmw_zenoh_cpp")],
    ids=lambda middleware: middleware.name,
)


@pytest.fixture
def other_dds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Middleware]:
    """The middleware of the example for contributors, as one more file of the package."""
    page = (ROOT / "CONTRIBUTING.md").read_text()
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    (tmp_path / "other_dds.py").write_text(example)
    caches = (known_middlewares, middleware_named)
    with monkeypatch.context() as patch:
        patch.setattr(r2bspec.middleware, "__path__", [*r2bspec.middleware.__path__, str(tmp_path)])
        for cache in caches:
            cache.cache_clear()
        yield middleware_named("rmw_other_cpp")
    for cache in caches:
        cache.cache_clear()
    del sys.modules["r2bspec.middleware.other_dds"]


def test_one_file_is_all_that_another_one_takes(other_dds: Middleware) -> None:
    assert other_dds.name == "Other DDS"
    assert set(other_dds.variables) <= set(inherited_variables())
    assert refuse_transport("inherit", "rmw_other_cpp") is None
    assert refuse_transport("udp", "rmw_other_cpp") is not None
    other_dds.transports = ("inherit", "udp")
    assert refuse_transport("udp", "rmw_other_cpp") is None
    refusal = refuse_transport("udp", "rmw_cyclonedds_cpp")
    assert refusal is not None
    assert refusal.help.endswith("set it to rmw_fastrtps_cpp or rmw_other_cpp")


@pytest.mark.parametrize("middleware", known_middlewares(), ids=lambda each: each.name)
def test_the_page_names_what_is_known_of_each(middleware: Middleware) -> None:
    page = PAGE.read_text()
    variables = [variable.replace("*", r"\*") for variable in middleware.variables]
    named = (*middleware.implementations, *variables, *middleware.override_variables)
    for each in (middleware.name, *named, *DISCOVERY_VARIABLES):
        assert each in page


@EVERY_ONE
def test_what_it_does_not_configure_is_refused_with_a_way_out(middleware: Middleware) -> None:
    for rmw in middleware.implementations:
        refused = {kind for kind in KINDS if refuse_transport(kind, rmw) is not None}
        assert refused == set(KINDS) - set(middleware.transports)
        for kind in refused:
            refusal = refuse_transport(kind, rmw)
            assert refusal is not None
            assert kind in refusal.message
            assert rmw in refusal.message
            assert "'transport: inherit'" in refusal.help
            assert "unset RMW_IMPLEMENTATION, or set it to rmw_fastrtps_cpp" in refusal.help


@EVERY_ONE
def test_only_fast_dds_takes_shared_memory(middleware: Middleware, tmp_path: Path) -> None:
    (tmp_path / "fastrtps_0123").touch()
    (tmp_path / "fastrtps_0123_el").touch()
    fast = middleware.name == "Fast DDS"
    assert middleware.uses_shared_memory == fast
    assert bool(middleware.segment_bytes(MessageTransport("shared_memory", 1_000_000))) == fast
    assert middleware.dead_shm_files(tmp_path) == (["fastrtps_0123"] if fast else [])
    assert middleware.remove_dead_shm_files(tmp_path) == (["fastrtps_0123"] if fast else [])
    assert len(list(tmp_path.iterdir())) == (0 if fast else 2)


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
