"""From metrics and objectives to verdicts, with the statistics that decide them."""
