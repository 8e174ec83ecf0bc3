"""The live page of a graph: a server that listens to the topics, decimates, and pushes frames to browsers."""
