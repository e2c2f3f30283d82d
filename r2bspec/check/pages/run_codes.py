"""R2B619 to R2B671: what can go wrong while a benchmark runs, and with its folder."""

from __future__ import annotations

from r2bspec.check.pages._page import error_page

RUN_PAGES = (
    error_page(
        "R2B619",
        "the plan asks for what this version does not carry out",
        "It is valid, and can be planned and drawn. The message names the parts of the plan that "
        "a later version will run.",
    ),
    error_page(
        "R2B620",
        "ROS 2 is not installed",
        "Running needs rclpy: source a ROS 2 installation, or pip install 'r2bspec[ros]'. "
        "Validating, planning and judging do not.",
    ),
    error_page(
        "R2B630",
        "the run failed",
        "The message says which process failed and why; what it printed is in the run folder "
        "under logs/. What had been observed until then is kept.",
    ),
    error_page(
        "R2B631",
        "a process ended before its time",
        "Nobody had told it to. What it printed is in the run folder under logs/.",
    ),
    error_page(
        "R2B632",
        "a process does not answer",
        "It may be blocked in a callback or a constructor; what it printed is in the run folder "
        "under logs/.",
    ),
    error_page(
        "R2B633",
        "a node could not be made",
        "Its constructor raised an exception. A Python node takes the keyword arguments of "
        "rclpy's Node and passes them on.",
    ),
    error_page(
        "R2B634",
        "a callback raised an exception",
        "The node did not do its work, so what was measured is not the graph's performance.",
    ),
    error_page(
        "R2B635",
        "a process uses more memory than it may",
        "Its resident memory exceeded the 'memory_limit' that the spec sets for it.",
    ),
    error_page(
        "R2B636",
        "a processor is not there",
        "'cpus' names processors, counted from 0, that this machine does not have or does not "
        "give to this user.",
    ),
    error_page(
        "R2B637",
        "a process may not be given this priority",
        "A 'nice' below 0 puts a process before others, which only a privileged user may do.",
    ),
    error_page(
        "R2B640",
        "the graph did not come up as planned",
        "Within 'benchmark.start_timeout' not every planned writer found its reader. The message "
        "names the first topic on the way where one of the two is missing. Where the nodes are all "
        "there and simply have other topics than the spec says, the code is that of the rule which "
        "finds the same (R2B204, R2B207, R2B208, R2B210, R2B216), and to try again would not help.",
    ),
    error_page(
        "R2B641",
        "nothing comes out of the graph",
        "All writers and readers have found each other, but no output was seen. Some messages are "
        "then played while every topic is watched; the message follows their way and says where "
        "they stop.",
    ),
    error_page(
        "R2B643",
        "a playback input has no messages",
        "Nothing of it was loaded or came out of the preprocessors, so there is nothing to play.",
    ),
    error_page(
        "R2B644",
        "the inputs have no stamp in common",
        "Messages of one step belong together by their header stamps; inputs that were not "
        "recorded together are played in specs of their own.",
    ),
    error_page(
        "R2B645",
        "the player did not finish in time",
        "The machine may be overloaded, or a publication blocks.",
    ),
    error_page(
        "R2B646",
        "a probe of readiness was not met in time",
        "The file, the service, the topic or the line of output that 'ready' waits for did not "
        "appear within its timeout.",
    ),
    error_page(
        "R2B647",
        "a service call failed",
        "The service is not there, is of another type, refuses the request, or does not answer "
        "within the timeout of its step.",
    ),
    error_page(
        "R2B648",
        "a step failed",
        "A command under 'setup' or 'after_ready' ended with an error, took longer than its "
        "timeout, or did not make the file that it 'creates'. Its output is in the run folder.",
    ),
    error_page(
        "R2B649",
        "an external node does not run",
        "A node that is 'external' must run before the benchmark starts, in the ROS domain of the "
        "run.",
    ),
    error_page(
        "R2B658",
        "a monitor that no step of the timeline concerns",
        "In a timeline a step has messages of the inputs that were recorded under one stamp, and "
        "it counts for the monitors that answer all of these. A graph that joins inputs of "
        "different rates answers one of them: write under 'monitors.NAME.answers' which.",
    ),
    error_page(
        "R2B659",
        "a timeline of which nobody knows the times",
        "What a preprocessor made is played when the message of its stamp was recorded. If the "
        "preprocessor writes stamps of its own, that is not known: write 'record_timeline: true', "
        "to play its messages at the times at which they come out of it.",
    ),
    error_page(
        "R2B650",
        "a run folder cannot be read",
        "A file of it is missing or damaged, or was written by another version. Files of a run "
        "appear whole or not at all, so one was changed afterwards, or the folder is no run.",
    ),
    error_page(
        "R2B651",
        "a run folder cannot be written",
        "It must be new or empty, and there must be space and the permission to write. '--output' "
        "chooses another.",
    ),
    error_page(
        "R2B654",
        "a history cannot be used",
        "The file is not there, damaged, of a newer version, of another program, or held by one "
        "that is writing. Run folders can be judged without it.",
    ),
    error_page(
        "R2B656",
        "there is nothing to compare with",
        "'--against' names another spec, var:NAME=VALUE, set:PATH=VALUE, or env: with a setup "
        "file, the folder of an installed workspace, or NAME=VALUE. A stored run cannot be played "
        "again; '--baseline' compares with one, as advice.",
    ),
    error_page(
        "R2B657",
        "an environment to compare with cannot be used",
        "There is no such setup file or workspace, sourcing it failed, or what it changes does "
        "not reach any process of a run: nodes inherit what ROS needs, and what the spec names "
        "under 'environment'.",
    ),
    error_page(
        "R2B664",
        "there is too little shared memory",
        "With 'transport: shared_memory' each process takes a segment of /dev/shm that holds "
        "several of the largest messages. Without room for it the middleware would use UDP and "
        "not say so, and images would take many times as long. Make /dev/shm larger (containers "
        "have 64 MB unless started with --shm-size), or state 'transport: udp'.",
    ),
    error_page(
        "R2B665",
        "a C++ component was not loaded",
        "The container answered that it cannot, or did not answer. Its own words follow; they "
        "tell a package or a class that is not installed from a constructor that failed. What the "
        "container printed is in the run folder under logs/.",
    ),
    error_page(
        "R2B670",
        "the run was interrupted",
        "By Ctrl-C or a signal. What had been observed until then is kept in the run folder and "
        "marked as incomplete.",
    ),
    error_page(
        "R2B671",
        "the run was killed",
        "Its controller ended without a chance to say why. The run folder has what had been "
        "written until then.",
    ),
)
