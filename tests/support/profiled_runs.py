"""Simulated runs with profiles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.record.run_record import ProfileRecord
from run_simulation import Played, Simulation

WHOLE = ProfileRecord(
    process="relay",
    profiler="perf",
    files=("profile/relay/relay.folded", "profile/relay/relay.perf.data"),
    stacks="profile/relay/relay.folded",
    rate_hz=30.0,
    began_ns=1,
    ended_ns=2,
)
MISSING = ProfileRecord(
    process="camera", profiler="py-spy", began_ns=1, ended_ns=2, error="process camera was killed"
)


def profiled_run(folder: Path, *profiles: ProfileRecord) -> ReportInput:
    """What the reports of a run with these profiles are made of."""
    run = Simulation(segments=[Played(30, np.full(90, 0.02))]).write(folder)
    run = replace(run, record=msgspec.structs.replace(run.record, profiles=profiles))
    return ReportInput(result=result_of(run), run=run)
