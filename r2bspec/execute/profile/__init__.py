"""Playing one more iteration with a profiler, after everything that counts."""
