"""The emulated network of a run: a network namespace whose loopback delays and drops packets.

All processes that are measured, player, monitors and observer included, run in it, so that each
message from one to another passes the queueing discipline netem once. Packets have at most 1500
bytes, as on Ethernet. Without privileges, the namespace belongs to a user namespace of this user.

File descriptors keep the namespace: it vanishes with this process and those in it, however they
end.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
from typing import Final

from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.language.spec import Network

_SYSTEM_FOLDERS: Final = "/usr/sbin:/sbin:/usr/bin:/bin"
_PACKAGES: Final = {"unshare": "util-linux", "nsenter": "util-linux"}
_MTU: Final = 1500
_QUEUE: Final = 100_000
"""Packets on their way; beyond its default of 1,000, netem drops those of a few large messages."""


class NetworkError(R2bspecError):
    """This machine cannot emulate a network."""

    code = "R2B421"
    exit_code = ExitStatus.USAGE


def netem_arguments(network: Network) -> list[str]:
    """Return the arguments of tc for a network; jitter is uniform, and may change the order."""
    words = ["limit", str(_QUEUE)]
    if network.delay is not None:
        jitter_ns = 0 if network.jitter is None else network.jitter.ns
        words += ["delay", f"{network.delay.ns / 1e3:.3f}us", f"{jitter_ns / 1e3:.3f}us"]
    if network.loss is not None:
        words += ["loss", f"{network.loss.fraction * 100:g}%"]
    if network.rate is not None:
        words += ["rate", f"{network.rate.bytes * 8}bit"]
    return words


class NetworkNamespace:
    """The namespace of a run.

    Attributes:
        prefix: the words before a command line that start it in the namespace.
    """

    def __init__(self, network: Network) -> None:
        """Create the namespace.

        Raises:
            NetworkError: a program, a permission or a part of the kernel is missing.
        """
        unshare, nsenter, ip, tc = map(_program, ("unshare", "nsenter", "ip", "tc"))
        is_unprivileged = os.geteuid() != 0
        device = [ip, "link", "set", "lo", "mtu", str(_MTU), "up"]
        discipline = [tc, "qdisc", "add", "dev", "lo", "root", "netem", *netem_arguments(network)]
        script = f"echo made && {shlex.join(device)} && {shlex.join(discipline)} && echo ready"
        maker = subprocess.Popen(
            [
                *(unshare, *["--map-root-user"] * is_unprivileged, "--net", "--"),
                *("sh", "-c", f"{script} && read _"),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._files: dict[str, int] = {}
        with maker:
            assert maker.stdout is not None and maker.stderr is not None  # noqa: S101, PT018
            said = [maker.stdout.readline().strip() for _ in range(2)]
            if said[1] != "ready":
                raise _refusal(maker.stderr.read().strip(), is_made=said[0] == "made")
            for kind in ("user", "net") if is_unprivileged else ("net",):
                place = f"/proc/{maker.pid}/ns/{kind}"
                self._files[kind] = os.open(place, os.O_RDONLY | os.O_CLOEXEC)
        places = [f"--{kind}=/proc/{os.getpid()}/fd/{file}" for kind, file in self._files.items()]
        self.prefix = (nsenter, *places, *["--preserve-credentials"] * is_unprivileged, "--")

    def close(self) -> None:
        """Let the namespace end with its last process."""
        while self._files:
            os.close(self._files.popitem()[1])


def why_not_emulated() -> NetworkError | None:
    """Return why this machine cannot emulate a network; None if it can."""
    try:
        NetworkNamespace(Network()).close()
    except NetworkError as error:
        return error
    return None


def _program(name: str) -> str:
    path = shutil.which(name) or shutil.which(name, path=_SYSTEM_FOLDERS)
    if path is None:
        raise NetworkError(
            f"no network can be emulated: the program {name} is missing",
            hint=f"Install {_PACKAGES.get(name, 'iproute2')}, or remove 'network' from the spec.",
        )
    return path


def _refusal(said: str, *, is_made: bool) -> NetworkError:
    if not is_made:
        why = f"a network namespace is not permitted ({said})"
        hint = "Run as root or with user namespaces; in a container, with --cap-add SYS_ADMIN."
    elif "qdisc kind is unknown" in said:
        why = "this kernel has no sch_netem"
        hint = "Load it ('sudo modprobe sch_netem', of linux-modules-extra on some systems), or "
        hint += "use a kernel with CONFIG_NET_SCH_NETEM."
    else:
        why = f"a network device cannot be set up ({said})"
        hint = "That takes CAP_NET_ADMIN: in a container, --cap-add NET_ADMIN."
    return NetworkError(f"no network can be emulated: {why}", hint=hint)
