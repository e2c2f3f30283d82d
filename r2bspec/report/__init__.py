"""One module for each output format of a result (`r2bspec.judge.judge_run`)."""
