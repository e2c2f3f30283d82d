"""The differences between ROS middlewares (RMW): one module for each.

`r2bspec.middleware.middleware` tells which is selected; nothing outside this package knows any of
them by name. docs/middleware.md says what each sets, CONTRIBUTING how to add one.
"""
