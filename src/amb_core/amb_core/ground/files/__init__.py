"""Reading and writing of files, used everywhere: regular files of limited size, parameter files, MATLAB files."""
