"""What messages carry as the library's own types: one file per message, both ways where both are needed.

Fields are read and set by name, so that a message may be one of ROS or one decoded from a bag. Nothing is imported
here: who converts telemetry alone needs no region map, which loads a compiler.
"""
