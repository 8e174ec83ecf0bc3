"""Files as they are read and written everywhere: regular ones of bounded size, parameter files, MATLAB files."""
