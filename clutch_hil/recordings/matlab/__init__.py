"""MATLAB files: the values in a file of level 4, 5 or 7.3 as a tree, objects, and the layouts that become channels."""
