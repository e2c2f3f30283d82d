"""One self-contained HTML page: no network, and complete without scripts or styles.

Numbers are in tables; drawings are inline SVG with presentation attributes; a stylesheet and a
script, both inside the page, add layout, dark mode, zoom and hover where a policy allows them.
"""
