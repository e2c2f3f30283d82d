"""The keys of ``ROS2BenchmarkConfig``, and what becomes of them in a spec."""

from __future__ import annotations

from typing import Final

TOOL_KEYS: Final = frozenset(
    [
        "default_config_version",
        "enable_resource_profiler",
        "resource_profiling_interval_sec",
        "setup_service_client_timeout_sec",
        "start_recording_service_timeout_sec",
        "default_service_future_timeout_sec",
        "set_data_service_future_timeout_sec",
        "start_recording_service_future_timeout_sec",
        "play_messages_service_future_timeout_sec",
        "pre_stop_monitoring_wait_time_sec",
        "pre_trial_run_wait_time_sec",
        "post_trial_run_wait_time_sec",
        "enable_trial_buffer_preparation",
        "log_folder",
        "log_file_name",
        "export_monitor_raw_data",
        "assets_root",
        "ros1_ws",
        "enforce_publisher_rate",
        "binary_search_terminal_interval_width",
        "binary_search_duration_fraction",
        "binary_search_acceptable_frame_rate_drop",
        "linear_scan_step_size",
        "linear_scan_duration_fraction",
        "linear_scan_acceptable_frame_loss_fraction",
        "linear_scan_acceptable_frame_rate_drop",
        "revise_timestamps_as_message_ids",
        "collect_start_timestamps_from_monitors",
        "option",
    ]
)
"""Keys of the configuration that tune the tool itself: its timeouts, waits, search and files."""
IMPORTED_KEYS: Final = frozenset(
    [
        "benchmark_name",
        "benchmark_namespace",
        "benchmark_mode",
        "benchmark_duration",
        "test_iterations",
        "custom_report_info",
        "input_data_path",
        "input_data_start_time",
        "input_data_end_time",
        "publish_tf_messages_in_set_data",
        "publish_tf_static_messages_in_set_data",
        "load_data_in_real_time",
        "record_data_timeline",
        "monitor_info_list",
        "playback_message_buffer_size",
        "publisher_upper_frequency",
        "publisher_lower_frequency",
        "additional_fixed_publisher_rate_tests",
        "binary_search_acceptable_frame_loss_fraction",
    ]
)
"""Keys with a counterpart in a spec."""
