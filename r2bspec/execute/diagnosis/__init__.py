"""Diagnosis of missing messages: the first fault on the planned path."""
