"""One server for all that its answers are asked about: no question changes it."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
import pytest_asyncio
from lsprotocol import types
from pytest_lsp import ClientServerConfig, client_capabilities

import patient_language_server
from ament_packages import install_package
from open_document import NODES, OpenDocument, VersionedClient


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace with a node and an installed package."""
    folder = tmp_path_factory.mktemp("workspace")
    (folder / "nodes.py").write_text(NODES)
    install_package(
        folder / "install",
        "cell_vision",
        {},
        ["detect"],
        rclcpp_components="cell_vision::Detector;lib/libdetector.so\n",
        rosidl_interfaces="msg/Found.msg\nmsg/Found.idl\nsrv/Ask.srv\n",
    )
    return folder


@pytest_asyncio.fixture(scope="session", loop_scope="session")
async def client(folder: Path) -> AsyncIterator[VersionedClient]:
    """An editor whose server knows the package that is installed in the workspace."""
    config = ClientServerConfig(
        client_factory=VersionedClient,
        server_command=patient_language_server.COMMAND,
        server_env={**os.environ, "AMENT_PREFIX_PATH": str(folder / "install")},
    )
    client = await config.start()
    assert isinstance(client, VersionedClient)
    await client.initialize_session(
        types.InitializeParams(
            capabilities=client_capabilities("visual-studio-code"),
            workspace_folders=[types.WorkspaceFolder(folder.as_uri(), "robot")],
        )
    )
    yield client
    await client.shutdown_session()
    await client.stop()  # type: ignore[no-untyped-call]


@pytest.fixture
def document(client: VersionedClient, folder: Path) -> Iterator[OpenDocument]:
    document = OpenDocument(client, folder / "robot.r2b.yaml")
    yield document
    document.close()
