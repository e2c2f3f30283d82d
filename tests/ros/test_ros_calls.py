"""Requests of service calls, filled from what a spec says."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from rcl_interfaces.srv import GetParameters, SetParameters

from r2bspec.harness.service_client import ServiceCallError, fill_message, service_class


def test_nested_messages_and_sequences_of_them_are_made() -> None:
    values = {
        "parameters": [
            {"name": "ratio", "value": {"type": 3, "double_value": 2}},
            {"name": "names", "value": {"type": 9, "string_array_value": ["a", "b"]}},
        ]
    }
    request = fill_message(SetParameters.Request(), values)
    assert [each.name for each in request.parameters] == ["ratio", "names"]
    assert request.parameters[0].value.double_value == 2.0
    assert list(request.parameters[1].value.string_array_value) == ["a", "b"]


def test_nothing_said_leaves_the_defaults() -> None:
    assert list(fill_message(GetParameters.Request(), {}).names) == []


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"nmes": []}, "the request has no field 'nmes'; its fields: names"),
        ({"names": 3}, "names cannot be 3: its type is sequence<string>"),
    ],
)
def test_a_field_that_is_wrong_is_named(values: dict[str, object], said: str) -> None:
    with pytest.raises(ServiceCallError, match=said):
        fill_message(GetParameters.Request(), values)


def test_a_service_type_that_is_not_installed() -> None:
    assert service_class("rcl_interfaces/srv/GetParameters") is GetParameters
    for wrong in ("nowhere/srv/Nothing", "rcl_interfaces/srv/Nothing", "nonsense"):
        with pytest.raises(ServiceCallError, match="is not installed"):
            service_class(wrong)
