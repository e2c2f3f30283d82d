"""What an editor sends, as far as it is read, and what is wrong with it.

Shapes, ranges and counts are checked by decoding.
Only what is named here is made in memory: everything else of a message is passed over. What the
server sends has the types of lsprotocol.
"""

from __future__ import annotations

from typing import Annotated, TypeVar

import msgspec
from lsprotocol import types
from msgspec import Meta

from r2bspec.safe_io.limits import MAX_EDITOR_CURSORS, MAX_EDITOR_ITEMS, MAX_NAME_CHARACTERS

Integer = Annotated[int, Meta(ge=-(2**31), le=2**31 - 1)]
Unsigned = Annotated[int, Meta(ge=0, le=2**31 - 1)]
# Wider than the protocol's: it is only sent back.
Identifier = (
    Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)]
    | Annotated[str, Meta(max_length=MAX_NAME_CHARACTERS)]
)
Id = int | str
T = TypeVar("T")
_SOME = Meta(max_length=MAX_EDITOR_ITEMS)


class RequestError(Exception):
    """What is wrong with a message, as the answer says it.

    Attributes:
        code: of the protocol.
        id: of the message, where it is known.
    """

    def __init__(self, code: int, message: str, identifier: Id | None = None) -> None:
        super().__init__(message)
        self.code = int(code)
        self.id = identifier


def invalid_params(message: str) -> RequestError:
    """What a request is about cannot be."""
    return RequestError(types.ErrorCodes.InvalidParams, message)


class Received(msgspec.Struct, rename="camel"):
    """A part of a message."""


class Position(Received):
    """A place in a text: of a line, and of a character in units of the negotiated encoding."""

    line: Unsigned
    character: Unsigned


class Range(Received):
    """From one place to another."""

    start: Position
    end: Position


class Named(Received):
    """A document, or a folder of the workspace, by its URI."""

    uri: str


class DocumentParams(Received):
    """A request about a document."""

    text_document: Named


class PositionParams(DocumentParams):
    """A request about a place in a document."""

    position: Position


class ReferenceContext(Received):
    """Which places of a name are wanted."""

    include_declaration: bool


class ReferenceParams(PositionParams):
    """A request for the places of the name at a place."""

    context: ReferenceContext


class RenameParams(PositionParams):
    """A request to rename what is at a place."""

    new_name: str


class RangeParams(DocumentParams):
    """A request about a part of a document."""

    range: Range


class ActionContext(Received):
    """Which kinds of actions are wanted; None for all."""

    only: Annotated[list[str], _SOME] | None = None


class ActionParams(RangeParams):
    """A request for what can be done about a part of a document."""

    context: ActionContext


class SelectionParams(DocumentParams):
    """A request for the selections around places."""

    positions: Annotated[list[Position], Meta(max_length=MAX_EDITOR_CURSORS)]


class OpenedDocument(Named):
    """A document with its text."""

    version: Integer
    text: str


class OpenParams(Received):
    """A document is opened."""

    text_document: OpenedDocument


class Change(Received):
    """A new text in a range, or, without one, of the whole document."""

    text: str
    range: Range | None = None


class ChangedDocument(Named):
    """The version of a document after its changes."""

    version: Integer | None = None


class ChangeParams(Received):
    """A document is changed, by one change after the other."""

    text_document: ChangedDocument
    content_changes: Annotated[list[Change], _SOME]


class FileParams(Received):
    """Files on disk have changed."""

    changes: Annotated[list[Named], _SOME]


class FolderChanges(Received):
    """Folders that the workspace has now, and that it no longer has."""

    added: Annotated[list[Named], _SOME]
    removed: Annotated[list[Named], _SOME]


class FolderParams(Received):
    """The folders of the workspace have changed."""

    event: FolderChanges


class CancelParams(Received):
    """A request is not wanted any more."""

    id: Identifier


class CommandParams(Received):
    """A command, and its arguments as they were sent."""

    command: str
    arguments: Annotated[list[msgspec.Raw], _SOME] = []


class ShowDocument(Received):
    """Whether the editor opens documents that the server names."""

    support: bool = False


class WindowAbilities(Received):
    """What the window of the editor can do."""

    show_document: ShowDocument | None = None


class CompletionItemAbilities(Received):
    """Whether the editor understands placeholders."""

    snippet_support: bool = False


class CompletionAbilities(Received):
    """What the editor does with a proposal.

    Attributes:
        insert_text_mode: 1 if it leaves the lines of a text as they are; it indents them otherwise.
    """

    completion_item: CompletionItemAbilities | None = None
    insert_text_mode: Integer | None = None


class RenameAbilities(Received):
    """Whether the editor asks what can be renamed before it does so."""

    prepare_support: bool = False


class DocumentAbilities(Received):
    """What the editor can do in a document."""

    rename: RenameAbilities | None = None
    completion: CompletionAbilities | None = None


class LensAbilities(Received):
    """Whether the editor asks again for lenses when it is told to."""

    refresh_support: bool = False


class WorkspaceAbilities(Received):
    """What the editor can do in a workspace."""

    code_lens: LensAbilities | None = None


class GeneralAbilities(Received):
    """The units in which the editor can count characters, the best first."""

    position_encodings: Annotated[list[str], _SOME] | None = None


class Abilities(Received):
    """What the editor can do."""

    general: GeneralAbilities | None = None
    window: WindowAbilities | None = None
    text_document: DocumentAbilities | None = None
    workspace: WorkspaceAbilities | None = None


class InitializeParams(Received):
    """What the editor is, and the folders that it has open."""

    capabilities: Abilities
    workspace_folders: Annotated[list[Named], _SOME] | None = None
    root_uri: str | None = None


def decoded(value: msgspec.Raw, kind: type[T]) -> T:
    """A part of a message, of a type.

    Raises:
        RequestError: it is not of this type.
    """
    try:
        return msgspec.json.decode(value, type=kind)
    except (msgspec.DecodeError, RecursionError) as error:
        raise invalid_params(str(error)) from None
