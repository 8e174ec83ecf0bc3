"""Exit codes of `amb` in addition to 0 for success, 1 for an error and 2 for a wrong command line."""

NOT_VALIDATED = 3
"""`amb validate`: the model does not pass the validation. `amb compare`: none of the models does."""

CHECK_FAILED = 3
"""`amb commission`: a step has failed. `amb rig check`: the target does not keep to the protocol."""

NOT_CERTIFIED = 4
"""A check of the robustness certificate fails."""

NOT_THE_SAME = 5
"""A certificate that is computed again differs."""

INTERRUPTED = 130
"""After Ctrl-C, as usual in shells: 128 plus the number of SIGINT."""
