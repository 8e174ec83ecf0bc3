"""The nodes of a graph: launch files, processes, parameters, readiness."""
