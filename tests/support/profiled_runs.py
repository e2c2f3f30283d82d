"""Records of profiles."""

from __future__ import annotations

from r2bspec.record.run_record import ProfileRecord

WHOLE = ProfileRecord(
    process="relay",
    profiler="perf",
    files=("profile/relay/relay.folded", "profile/relay/relay.perf.data"),
    rate_hz=30.0,
    began_ns=1,
    ended_ns=2,
)
MISSING = ProfileRecord(
    process="camera", profiler="py-spy", began_ns=1, ended_ns=2, error="process camera was killed"
)
