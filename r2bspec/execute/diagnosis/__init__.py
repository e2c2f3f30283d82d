"""Diagnosis of missing messages: which hop of the planned path is the first that is broken."""
