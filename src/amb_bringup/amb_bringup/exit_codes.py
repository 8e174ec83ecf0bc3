"""Exit codes of `amb` in addition to 0 for success, 1 for an error and 2 for a wrong command line."""

NOT_VALIDATED = 3
"""The model does not pass the validation."""

NOT_CERTIFIED = 4
"""A check of the robustness certificate fails."""

NOT_THE_SAME = 5
"""A certificate that is computed again differs."""

INTERRUPTED = 130
"""After Ctrl-C, as usual in shells: 128 plus the number of SIGINT."""
