"""Recorded data: locating storage, indexing, reading, hashing and verifying rosbags."""
