"""Recorded buses: the frames of a log in order of time, whatever the format of the file."""
