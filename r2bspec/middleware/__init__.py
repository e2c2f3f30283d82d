"""What differs between ROS middlewares (RMW): one module for each.

Ask `r2bspec.middleware.middleware` which one is selected; nothing outside this package knows any of
them by name. docs/middleware.md says what each sets, and how to add one.
"""
