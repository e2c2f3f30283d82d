"""The mathematics behind the verdicts: each module states its test and implements it."""
