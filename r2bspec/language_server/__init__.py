"""The language server: `r2bspec lsp`, over the same code as `r2bspec validate`.

Each module answers one kind of request from an `Analysis` and knows nothing of the connection;
`server` connects them.
"""
