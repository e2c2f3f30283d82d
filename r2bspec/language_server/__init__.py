"""The language server: `r2bspec lsp`, over the same code as `r2bspec validate`.

`messages` is what editors send, and `transport` the connection, on which every message is answered.
Each other module answers one kind of request from an `Analysis` and knows nothing of the
connection; `server` connects them.
"""
