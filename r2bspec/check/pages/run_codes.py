"""R2B619 to R2B697: errors of a run, of its folder, and of r2bspec itself."""

from __future__ import annotations

from r2bspec.check.pages._page import error_page

RUN_PAGES = (
    error_page(
        "unsupported-by-this-version",
        "R2B619",
        "plan uses unsupported features",
        "The plan is valid and can be drawn, but this version cannot run all of it. The message "
        "names the unsupported parts.",
    ),
    error_page(
        "ros-not-installed",
        "R2B620",
        "ROS 2 is not installed",
        "Running needs rclpy: source a ROS 2 installation, or pip install 'r2bspec[ros]'. "
        "Validating, planning and judging do not need it.",
    ),
    error_page(
        "process-not-joinable",
        "R2B674",
        "player and monitors cannot join a process of the graph",
        "With 'harness: {placement: graph}' player and monitors are loaded into the processes that "
        "read the inputs and publish the outputs. A program that is linked statically, that runs "
        "as another user than its caller (setuid), or that uses another C library does not load "
        "them; neither does a process that is no ROS node, or that its wrapper starts without the "
        "variables that it got. Use 'harness: {placement: separate}' for such graphs.",
    ),
    error_page(
        "run-failed",
        "R2B630",
        "run failed",
        "The message names the process that failed and the reason; the output of the process is in "
        "the run folder under logs/. Measurements up to the failure are kept.",
    ),
    error_page(
        "process-ended-early",
        "R2B631",
        "process ended early",
        "The process ended before the run stopped it. Its output is in the run folder under logs/.",
    ),
    error_page(
        "process-not-responding",
        "R2B632",
        "process does not respond",
        "The process may be blocked in a callback or a constructor. Its output is in the run "
        "folder under logs/.",
    ),
    error_page(
        "node-constructor-failed",
        "R2B633",
        "node cannot be created",
        "The constructor raised an exception. A Python node must accept the keyword arguments of "
        "rclpy's Node and pass them on.",
    ),
    error_page(
        "callback-raised",
        "R2B634",
        "callback raised an exception",
        "The node did not do its work, so the measurements do not show the performance of the "
        "graph.",
    ),
    error_page(
        "memory-limit-exceeded",
        "R2B635",
        "process exceeds its memory limit",
        "The resident memory of the process exceeded the 'memory_limit' of the spec.",
    ),
    error_page(
        "cpu-not-available",
        "R2B636",
        "CPU is not available",
        "'cpus' lists CPUs, counted from 0, that this machine does not have or does not grant to "
        "this user.",
    ),
    error_page(
        "priority-not-permitted",
        "R2B637",
        "priority is not permitted",
        "A 'nice' below 0 raises the priority of a process, which only a privileged user may do.",
    ),
    error_page(
        "graph-not-connected",
        "R2B640",
        "graph is not connected as planned",
        "Some planned publishers and subscriptions were not matched within "
        "'benchmark.start_timeout'. The message names the first topic of the path on which one of "
        "the two is missing. If all nodes run, but use other topics than the spec states, the code "
        "is that of the rule for the same error (R2B204, R2B207, R2B208, R2B210, R2B216), and "
        "another attempt would not help.",
    ),
    error_page(
        "no-output",
        "R2B641",
        "graph has no output",
        "All publishers and subscriptions are matched, but no output was observed. Some messages "
        "are then played while every topic is observed; the message traces their path and says "
        "where they stop.",
    ),
    error_page(
        "input-without-messages",
        "R2B643",
        "playback input has no messages",
        "No messages of the input were loaded or published by the preprocessors, so there is "
        "nothing to play.",
    ),
    error_page(
        "no-common-stamps",
        "R2B644",
        "inputs have no common stamps",
        "The messages of one step are matched by their header stamps. Play inputs that were not "
        "recorded together in separate specs.",
    ),
    error_page(
        "player-timeout",
        "R2B645",
        "player did not finish in time",
        "The machine may be overloaded, or a publish call blocks.",
    ),
    error_page(
        "readiness-timeout",
        "R2B646",
        "readiness probe timed out",
        "The file, service, topic or output line that 'ready' waits for did not appear within its "
        "timeout.",
    ),
    error_page(
        "service-call-failed",
        "R2B647",
        "service call failed",
        "The service does not exist, has another type, rejects the request, or does not respond "
        "within the timeout of its step.",
    ),
    error_page(
        "step-failed",
        "R2B648",
        "step failed",
        "A command under 'setup' or 'after_ready' returned an error, exceeded its timeout, or did "
        "not create the file that 'creates' names. Its output is in the run folder.",
    ),
    error_page(
        "external-node-not-running",
        "R2B649",
        "external node is not running",
        "Start a node that is 'external' before the benchmark, in the ROS domain of the run.",
    ),
    error_page(
        "monitor-without-steps",
        "R2B658",
        "monitor without steps of the timeline",
        "A step of a timeline has the messages of all inputs with the same stamp. It counts for "
        "the monitors that answer all of these inputs. A graph that joins inputs of different "
        "rates answers one of them: name it under 'monitors.NAME.answers'.",
    ),
    error_page(
        "timeline-times-unknown",
        "R2B659",
        "times of the timeline are unknown",
        "Messages of a preprocessor are played at the time at which the message with the same "
        "stamp was recorded. If the preprocessor sets its own stamps, this time is unknown: set "
        "'record_timeline: true' to play its messages at the times at which it publishes them.",
    ),
    error_page(
        "run-folder-unreadable",
        "R2B650",
        "run folder cannot be read",
        "A file is missing, damaged or of another version. A run writes each file completely or "
        "not at all, so the file was changed later, or the folder is not a run folder.",
    ),
    error_page(
        "run-folder-not-writable",
        "R2B651",
        "run folder cannot be written",
        "The folder must be new or empty, with free space and write permission. '--output' sets "
        "another folder.",
    ),
    error_page(
        "profiler-unusable",
        "R2B652",
        "profiler cannot be used",
        "The profiler of '--profile' is not installed, or the system does not let it observe "
        "processes. Nothing has been measured: install it, permit it, or run without '--profile'.",
    ),
    error_page(
        "history-unusable",
        "R2B654",
        "history cannot be used",
        "The file does not exist, is damaged, belongs to a newer version or another program, or is "
        "locked by a process that writes to it. Run folders can be judged without a history.",
    ),
    error_page(
        "nothing-to-compare",
        "R2B656",
        "nothing to compare with",
        "'--against' takes another spec, var:NAME=VALUE, set:PATH=VALUE, or env: with a setup "
        "file, the folder of an installed workspace, or NAME=VALUE. A stored run cannot be played "
        "again; '--baseline' compares with a stored run, as information only.",
    ),
    error_page(
        "compared-environment-unusable",
        "R2B657",
        "environment to compare with cannot be used",
        "The setup file or workspace does not exist, sourcing it failed, or its changes do not "
        "reach any process of a run: nodes inherit the variables that ROS needs, and those that "
        "the spec lists under 'environment'.",
    ),
    error_page(
        "too-little-shared-memory",
        "R2B664",
        "too little shared memory",
        "With 'transport: shared_memory' each process allocates a segment of /dev/shm for several "
        "of the largest messages. Without space for it, the middleware would use UDP without a "
        "warning, and images would take many times as long. Enlarge /dev/shm (containers have "
        "64 MB unless started with --shm-size), or set 'transport: udp'.",
    ),
    error_page(
        "native-harness-not-built",
        "R2B668",
        "player and monitor cannot be built",
        "Player and monitor are C on rcl, which is compiled when a run first needs it and kept "
        "in the cache folder of the user. It needs a C compiler ('cc', or the one in $CC) and the "
        "headers of rcl: Debian and Ubuntu, 'apt install gcc libc6-dev'; the headers are in every "
        "ROS installation and in the wheels of 'r2bspec[ros]'. 'r2bspec doctor' tries it. Nothing "
        "is compiled by 'validate' and 'plan'.",
    ),
    error_page(
        "component-not-loaded",
        "R2B665",
        "C++ component was not loaded",
        "The container reported an error or did not respond. Its error shows whether the package "
        "or class is not installed, or the constructor failed. The output of the container is in "
        "the run folder under logs/.",
    ),
    error_page(
        "base-version-unreadable",
        "R2B667",
        "base version cannot be read",
        "--untrusted compares a spec with its version in a commit. There must be a git repository "
        "that has this commit; a shallow clone has to fetch it first.",
    ),
    error_page(
        "run-interrupted",
        "R2B670",
        "run was interrupted",
        "Ctrl-C or a signal stopped the run. Measurements up to then are kept in the run folder "
        "and marked as incomplete.",
    ),
    error_page(
        "run-killed",
        "R2B671",
        "run was killed",
        "The controller was killed and could not record the reason. The run folder has what had "
        "been written until then.",
    ),
    error_page(
        "internal-error",
        "R2B690",
        "error in r2bspec",
        "r2bspec met a situation that it was not written for. Nothing is known of the spec or the "
        "run: the exit status is 70, never that of a finding or of a verdict. Report it with the "
        "file that has the traceback; that file can contain values of your input.",
    ),
    error_page(
        "worker-ended",
        "R2B691",
        "process that checked a file ended",
        "'validate' shares many files out among processes. One of them was killed or crashed, so "
        "that nothing is known of the file that it checked. On a machine with too little memory "
        "the kernel kills processes.",
    ),
    error_page(
        "host-busy",
        "R2B697",
        "host is in use by another run",
        "Benchmarks that run at the same time measure each other, so 'run' and 'calibrate' have "
        "the host to themselves. --no-wait refuses instead of waiting, --no-lock or the variable "
        "R2BSPEC_NO_LOCK runs next to the other one.",
    ),
)
