"""GPUs, and the energy of the processors, sampled with CPU and memory if the machine reports them.

NVML reports what an NVIDIA GPU does now, not what it has done. Each level counts for the time since
the previous sample, so that rows are cumulative like processor time:

    busy_s(k) = busy_s(k-1) + utilisation(k) · (t(k) − t(k-1))

The sum is over all GPUs. A quantity that one of them does not tell is NaN, since a smaller sum
would be wrong; so is every quantity of a GPU that has been lost.

RAPL counts the energy of processor packages (``/sys/class/powercap/intel-rapl:N``, of AMD, too).
Since Linux 5.10 only root can read it.
"""

from __future__ import annotations

import contextlib
import math
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from r2bspec.extras import install_command
from r2bspec.judge.measure.host_usage import MACHINE_INDEX

_ROW: Final = struct.Struct("<qi6d")
"""A row of `r2bspec.record.sample_arrays.DEVICE_FIELDS`."""

_IDLE: Final = [0.0] * 4
_UNKNOWN: Final = [math.nan] * 4


class Gpus:
    """The NVIDIA GPUs of this machine.

    Attributes:
        names: the names of the models.
        why_not: why nothing is measured, as a clause; empty if something is.
    """

    def __init__(self) -> None:
        """Open NVML, which stays open."""
        self.names: list[str] = []
        self.why_not = ""
        self._devices: list[Any] = []
        self._energy_mj: dict[int, int] = {}
        self._seen_us: dict[int, int] = {}
        try:
            import pynvml
        except ImportError:
            self.why_not = f"NVML needs {install_command('gpu')}"
            return
        self._nvml = pynvml
        try:
            pynvml.nvmlInit()
            for number in range(pynvml.nvmlDeviceGetCount()):
                self._devices.append(pynvml.nvmlDeviceGetHandleByIndex(number))
                self.names.append(str(pynvml.nvmlDeviceGetName(self._devices[-1])))
        except pynvml.NVMLError as error:
            self.why_not, self._devices = f"NVML says: {error}", []
        if not self._devices:
            self.why_not = self.why_not or "NVML knows no GPU"

    def grown(self, seconds: float) -> tuple[float, float, float, float, float]:
        """Return the growth of busy, encoder and decoder time and of energy, and the memory in use.

        Args:
            seconds: the time since the last call.
        """
        nvml = self._nvml if self._devices else None
        if nvml is None:
            return (math.nan,) * 5
        return (
            self._sum(lambda gpu: nvml.nvmlDeviceGetUtilizationRates(gpu).gpu / 100 * seconds),
            self._sum(lambda gpu: nvml.nvmlDeviceGetEncoderUtilization(gpu)[0] / 100 * seconds),
            self._sum(lambda gpu: nvml.nvmlDeviceGetDecoderUtilization(gpu)[0] / 100 * seconds),
            sum(self._joules(number, seconds) for number in range(len(self._devices))),
            self._sum(lambda gpu: float(nvml.nvmlDeviceGetMemoryInfo(gpu).used)),
        )

    def _sum(self, read: Callable[[Any], float]) -> float:
        try:
            return sum(map(read, self._devices))
        except self._nvml.NVMLError:
            return math.nan

    def _joules(self, number: int, seconds: float) -> float:
        """Return the energy since the last call; by the power where there is no counter."""
        nvml, gpu = self._nvml, self._devices[number]
        with contextlib.suppress(nvml.NVMLError):
            now_mj = nvml.nvmlDeviceGetTotalEnergyConsumption(gpu)
            before_mj = self._energy_mj.get(number, now_mj)
            self._energy_mj[number] = now_mj
            return float(now_mj - before_mj) / 1e3
        with contextlib.suppress(nvml.NVMLError):
            return float(nvml.nvmlDeviceGetPowerUsage(gpu) / 1e3 * seconds)
        return math.nan

    def processes(self, seconds: float) -> dict[int, list[float]] | None:
        """Return the growth of each process on the GPUs, without energy, by process id.

        None if a GPU does not report its processes, such as a part of a GPU (MIG).
        """
        grown: dict[int, list[float]] = {}
        for number, gpu in enumerate(self._devices):
            try:
                used_bytes = self._process_bytes(gpu)
            except self._nvml.NVMLError:
                return None
            levels = self._process_levels(number, gpu)
            for pid, memory in used_bytes.items():
                shares = _UNKNOWN[:3] if levels is None else levels.get(pid, _IDLE[:3])
                added = [*(share * seconds for share in shares), memory]
                grown[pid] = _added(grown.get(pid, _IDLE), added)
        return grown

    def _process_bytes(self, gpu: Any) -> dict[int, float]:
        """Return the memory of each process on a GPU; one that computes and draws is in both."""
        nvml = self._nvml
        listed = (
            *nvml.nvmlDeviceGetComputeRunningProcesses(gpu),
            *nvml.nvmlDeviceGetGraphicsRunningProcesses(gpu),
        )
        return {
            one.pid: math.nan if one.usedGpuMemory is None else float(one.usedGpuMemory)
            for one in listed
        }

    def _process_levels(self, number: int, gpu: Any) -> dict[int, list[float]] | None:
        """Return the use by processes that used a GPU since the last call; None if untold."""
        nvml = self._nvml
        try:
            found = nvml.nvmlDeviceGetProcessUtilization(gpu, self._seen_us.get(number, 0))
        except nvml.NVMLError as error:
            return {} if error.value == nvml.NVML_ERROR_NOT_FOUND else None
        self._seen_us[number] = max((one.timeStamp for one in found), default=0)
        return {one.pid: [one.smUtil / 100, one.encUtil / 100, one.decUtil / 100] for one in found}


class PackageEnergy:
    """The energy of all processor packages.

    Attributes:
        why_not: why it is not measured, as a clause; empty if it is.
    """

    def __init__(self, root: Path = Path("/")) -> None:
        """Find the counters.

        Args:
            root: where ``/sys`` is.
        """
        # Zones below a package are parts of it, and the same package has a zone of MMIO, too.
        zones = [
            zone
            for zone in sorted(root.glob("sys/class/powercap/intel-rapl:*"))
            if zone.name.count(":") == 1 and _text(zone / "name").startswith("package")
        ]
        self._ranges = {zone / "energy_uj": _text(zone / "max_energy_range_uj") for zone in zones}
        self._last_uj: dict[Path, int] = {}
        self._joules = 0.0
        self.why_not = "" if zones else "the kernel has no counter of the energy of packages (RAPL)"
        if unreadable := [str(path) for path in self._ranges if not _text(path)]:
            self.why_not = f"{unreadable[0]} cannot be read by this user"

    def read(self) -> float:
        """Return the energy in joules since the first call; NaN if it cannot be read."""
        if self.why_not:
            return math.nan
        try:
            for path, wraps_at in self._ranges.items():
                now = int(_text(path))
                grown = now - self._last_uj.get(path, now)
                self._joules += (grown if grown >= 0 else grown + int(wraps_at)) / 1e6
                self._last_uj[path] = now
        except ValueError:
            return math.nan
        return self._joules


class DeviceReader:
    """Makes the rows of GPUs and packages; nothing is opened before the first of them."""

    def __init__(self) -> None:
        self._opened: tuple[Gpus, PackageEnergy] | None = None
        self._last_ns = 0
        self._totals: dict[int, list[float]] = {}

    def rows(self, owners: Mapping[int, int]) -> Iterator[bytes]:
        """Yield the packed rows of one sample: of the machine, and of processes on GPUs.

        Args:
            owners: the processes of the run: process id to the index that its row has.
        """
        if self._opened is None:
            self._opened = Gpus(), PackageEnergy()
        gpus, package = self._opened
        if gpus.why_not and package.why_not:
            return
        now_ns = time.monotonic_ns()
        seconds = (now_ns - (self._last_ns or now_ns)) / 1e9
        self._last_ns = now_ns
        *grown, memory = gpus.grown(seconds)
        yield self._row(now_ns, MACHINE_INDEX, grown, package.read(), memory)
        by_process = gpus.processes(seconds)
        before = _UNKNOWN if by_process is None else _IDLE
        used = {index: before for index in self._totals if index != MACHINE_INDEX}
        for pid, values in (by_process or {}).items():
            if (index := owners.get(pid)) is not None:
                used[index] = _added(used.get(index, _IDLE), values)
        for index, (*of_process, memory) in used.items():
            yield self._row(now_ns, index, [*of_process, math.nan], math.nan, memory)

    def _row(
        self, now_ns: int, index: int, grown: list[float], package_j: float, memory: float
    ) -> bytes:
        before = self._totals.get(index, _IDLE)
        now = _added(before, grown)
        # What is unknown now is so in this row alone: later rows count from what was known.
        self._totals[index] = [
            old if math.isnan(new) else new for old, new in zip(before, now, strict=True)
        ]
        return _ROW.pack(now_ns, index, *now, package_j, memory)


def describe_devices() -> dict[str, Any]:
    """Return the names of the GPUs, and why GPUs or packages are not measured."""
    gpus = Gpus()
    return {
        "gpus": gpus.names,
        "gpu_unmeasured": gpus.why_not,
        "package_unmeasured": PackageEnergy().why_not,
    }


def _added(before: list[float], more: list[float]) -> list[float]:
    return [sum(pair) for pair in zip(before, more, strict=True)]


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""
