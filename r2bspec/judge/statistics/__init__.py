"""The statistics of the verdicts: each module states its test and implements it."""
