"""One module for each form of output; `r2bspec.judge.judge_run` holds what they all show."""
