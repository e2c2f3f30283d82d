"""What is played: the four workloads, as buffers that the player reads; and what is measured."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from r2bspec.ipc.buffers import BufferWriter

TYPE = "sensor_msgs/msg/Image"
TOPIC = "/bench/image"
COPIES = 8
"""Distinct messages in the buffer, so that the source is not always in the processor's cache."""


@dataclass(frozen=True)
class Workload:
    """Messages of one size at one rate."""

    name: str
    size: int
    rate_hz: float


SMALL, MEDIUM, LARGE = 240, 1280 * 720 * 3 + 64, 1920 * 1200 * 3 + 64

WORKLOADS = (
    Workload("240 B at 100 Hz", SMALL, 100.0),
    Workload("240 B at 1 kHz", SMALL, 1000.0),
    Workload("1280x720 rgb8 at 60 Hz", MEDIUM, 60.0),
    Workload("1920x1200 rgb8 at 60 Hz", LARGE, 60.0),
)


def message(size: int) -> Any:
    """An Image message whose serialised form has about this many bytes."""
    from sensor_msgs.msg import Image

    image = Image(height=1, encoding="rgb8")
    image.header.frame_id = "camera"
    image.data = bytes(max(0, size - 56))
    image.width, image.step = len(image.data) // 3, len(image.data)
    return image


def write_buffer(folder: Path, workload: Workload) -> None:
    """Write the buffer of a workload."""
    from rclpy.serialization import serialize_message

    data = serialize_message(message(workload.size))
    writer = BufferWriter(folder, TOPIC, TYPE, has_header=True)
    for number in range(COPIES):
        writer.append(number, data)
    writer.close()


@dataclass(frozen=True)
class Figures:
    """Times in milliseconds; `cpu_ms` is of publishing and receiving side together, per message."""

    received_p50: float
    received_p99: float
    taken_p50: float
    taken_p99: float
    cpu_ms: float
    sent: float
    lost: float


def figures(playback: Any, monitor: Any, spent_ns: int) -> Figures:
    """Match messages by their stamps and compare the times.

    Args:
        playback: rows of `r2bspec.record.sample_arrays.PLAYBACK_FIELDS`.
        monitor: rows of `r2bspec.record.sample_arrays.MONITOR_FIELDS`.
        spent_ns: processor time of both sides.
    """
    _, sent, got = np.intersect1d(playback["stamp_ns"], monitor["stamp_ns"], return_indices=True)
    published = playback["published_ns"][sent]
    return Figures(
        *_percentiles(monitor["received_ns"][got] - published),
        *_percentiles(monitor["taken_ns"][got] - published),
        cpu_ms=spent_ns / 1e6 / max(1, playback.size),
        sent=float(playback.size),
        lost=float(playback.size - sent.size),
    )


def _percentiles(values_ns: Any) -> tuple[float, float]:
    if not values_ns.size:
        return float("nan"), float("nan")
    p50, p99 = np.percentile(values_ns, [50, 99]) / 1e6
    return float(p50), float(p99)


def medians(several: Sequence[Figures]) -> Figures:
    """The median of each figure; of losses the sum, because one is one too many."""
    values = {
        each.name: float(np.median([getattr(one, each.name) for one in several]))
        for each in fields(Figures)
    }
    values["lost"] = sum(one.lost for one in several)
    values["sent"] = sum(one.sent for one in several)
    return Figures(**values)


def cpu_ns(pids: Iterable[int]) -> int:
    """Processor time of processes so far, from the scheduler where it tells, else in ticks."""
    return sum(_cpu_ns(pid) for pid in pids)


def _cpu_ns(pid: int) -> int:
    total = 0
    for file in Path(f"/proc/{pid}/task").glob("*/schedstat"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            total += int(file.read_text().split()[0])
    if total:
        return total
    times = psutil.Process(pid).cpu_times()
    return round((times.user + times.system) * 1e9)
