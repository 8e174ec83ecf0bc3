"""Converts messages to the library's own types and, where needed, back: one file per message.

Fields are read and set by name, so a message may come from ROS or be decoded from a bag. Nothing is imported here: code
that converts only telemetry does not need the region map, which loads a compiler.
"""
