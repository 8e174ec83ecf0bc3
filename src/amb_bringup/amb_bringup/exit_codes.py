"""What the exit codes of `amb` mean, besides 0 for success, 1 for an error and 2 for a wrong command line."""

NOT_VALIDATED = 3
"""The model does not pass the validation."""

INTERRUPTED = 130
"""After Ctrl-C, as shells have it: 128 and the number of SIGINT."""
