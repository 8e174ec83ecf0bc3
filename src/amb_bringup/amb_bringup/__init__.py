"""amb_bringup: launch files, parameter files and the command line amb."""
