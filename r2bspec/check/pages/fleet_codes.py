"""R2B677 and R2B682 to R2B689: machines that do not fit, and errors of a fleet."""

from __future__ import annotations

from r2bspec.check.pages._page import error_page

FLEET_PAGES = (
    error_page(
        "other-machine-required",
        "R2B677",
        "run is refused on this machine",
        "The spec requires another architecture, more cores, a GPU, another ROS distribution or a "
        "label. R2B676 says so before a run. R2BSPEC_LABELS has the labels of this machine; "
        "'run --on' finds a host that fits.",
    ),
    error_page(
        "fleet-unreachable",
        "R2B682",
        "fleet cannot be used",
        "The scheduler does not answer, a host failed, or Dask distributed is not installed "
        "(pip install 'r2bspec[fleet]').",
    ),
    error_page(
        "no-host",
        "R2B683",
        "no host can make the run",
        "The message has every host of the fleet with what it lacks of what the spec requires.",
    ),
    error_page(
        "version-differs",
        "R2B684",
        "versions of client and host differ",
        "Versions may measure and judge differently, so their results are not comparable. Install "
        "the same one on both.",
    ),
    error_page(
        "not-allowed-by-host",
        "R2B685",
        "host does not allow what the spec does",
        "A worker runs what is installed on its host: executables, components, Python classes and "
        "launch files of ROS packages, with a few variables that name no code. Commands, prefixes, "
        "setup steps and other variables need --allow-commands, and Python and launch files that "
        "specs bring along need --allow-python, which the owner of the host gives.",
    ),
    error_page(
        "transfer-failed",
        "R2B686",
        "files did not arrive",
        "Everything that travels is verified by its digest, and sent again if it differs. It "
        "differed repeatedly, or the files of a spec are too large to be sent with it.",
    ),
    error_page(
        "insecure-fleet",
        "R2B687",
        "connection is not secure",
        "Who reaches a scheduler runs programs on all of its hosts. Beyond this machine a "
        "connection needs TLS with certificates on both sides; --insecure goes without. Without "
        "TLS a worker listens on the loopback interface only, and never at all addresses.",
    ),
    error_page(
        "host-lost",
        "R2B688",
        "host left the fleet",
        "The host was switched off, unplugged, or its worker ended, and it did not return within "
        "--host-timeout. 'run --resume' makes the run later.",
    ),
    error_page(
        "host-full",
        "R2B689",
        "disk of a host is full",
        "The host could not store what was sent, or the run, or its shared memory is too small for "
        "the run. Free space there, or start its worker with a smaller --cache-limit.",
    ),
)
