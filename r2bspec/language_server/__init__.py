"""The language server: `r2bspec lsp`, over the same code as `r2bspec validate`.

`protocol` is what editors send, and the connection, on which every message is answered.
Each other module answers one kind of request from an `Analysis` and knows nothing of the
connection; `server` connects them.
"""
